//! Simple charts: strips of points by category with their mean, lines, bars.

use super::{Anchor, Colour, Image, TextSize};
use std::ops::Range;

/// Name and points (x, y, weight) of one line.
pub type WeightedSeries = (String, Vec<(f64, f64, f64)>);

/// Title and labels of a chart, its size and the range of its axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Stands above.
    pub title: String,
    /// Stands below the horizontal axis.
    pub x_label: String,
    /// Stands beside the vertical axis.
    pub y_label: String,
    /// Width in pixels, by default 760.
    pub width: usize,
    /// Height in pixels, by default 440.
    pub height: usize,
    /// Range of the vertical axis; by default from the data, with 0 unless the axis is logarithmic.
    pub y_range: Option<Range<f64>>,
    /// Whether the vertical axis is logarithmic; values that are not positive are then left out.
    pub y_log: bool,
    /// Range of a horizontal axis of numbers; by default from the data.
    pub x_range: Option<Range<f64>>,
    /// Whether a horizontal axis of numbers is logarithmic; values that are not positive are then left out.
    pub x_log: bool,
    /// Whether to draw the line y = x, faint.
    pub diagonal: bool,
}

impl Chart {
    /// A chart of the default size.
    pub fn new(title: &str, x_label: &str, y_label: &str) -> Self {
        let (title, x_label, y_label) = (title.into(), x_label.into(), y_label.into());
        let (y_range, x_range) = (None, None);
        Self { title, x_label, y_label, width: 760, height: 440, y_range, y_log: false, x_range, x_log: false, diagonal: false }
    }

    /// One strip of points per category with a bar at its mean (as in the paper's Fig. 3); values that are not finite are left out.
    pub fn strips(&self, categories: &[(String, Vec<f64>)]) -> Image {
        let values = categories.iter().flat_map(|(_, values)| values.iter().copied());
        let mut frame = Frame::new(self, values, Horizontal::Categories(categories.iter().map(|(n, _)| n.as_str()).collect()));
        for (c, (_, values)) in categories.iter().enumerate() {
            let values: Vec<f64> = values.iter().copied().filter(|v| frame.y_axis.shows(*v)).collect();
            let colour = Colour::SERIES[c % Colour::SERIES.len()];
            let (middle, step) = frame.category(c, categories.len());
            for (n, value) in values.iter().enumerate() {
                // Spread by the golden ratio: even, and the same every time.
                let spread = (n as f64 * 0.618_033_988_75).fract() - 0.5;
                frame.image.disc((middle + spread * step * 0.6) as i32, frame.y(*value), 5, colour.with_opacity(0.45));
            }
            if !values.is_empty() {
                let y = frame.y(values.iter().sum::<f64>() / values.len() as f64);
                let half = step * 0.36;
                frame.image.line(((middle - half) as i32, y), ((middle + half) as i32, y), 3, Colour::INK);
            }
        }
        frame.image
    }

    /// One bar per category and series, side by side, with the value above; `series` gives each a name and one value per category.
    pub fn bars(&self, categories: &[String], series: &[(String, Vec<f64>)]) -> Image {
        let values = series.iter().flat_map(|(_, values)| values.iter().copied());
        let names = categories.iter().map(String::as_str).collect();
        let mut frame = Frame::new(self, values, Horizontal::Categories(names));
        let zero = if frame.y_axis.log { frame.bottom } else { frame.y(0.0) };
        for (s, (_, values)) in series.iter().enumerate() {
            for (c, value) in values.iter().enumerate().filter(|(_, v)| frame.y_axis.shows(**v)).take(categories.len()) {
                let (middle, step) = frame.category(c, categories.len());
                let width = step * 0.8 / series.len() as f64;
                let (left, y) = (middle + (s as f64 - series.len() as f64 / 2.0) * width, frame.y(*value));
                let colour = Colour::SERIES[s % Colour::SERIES.len()];
                frame.image.rectangle(
                    left as i32 + 1,
                    y.min(zero),
                    (width as u32).saturating_sub(1).max(1),
                    y.abs_diff(zero).max(1),
                    colour,
                );
                let text = format!("{value:.2}");
                if TextSize::Small.width(&text) as f64 <= width {
                    frame.image.text(&text, (left + width / 2.0) as i32, y.min(zero) - 8, TextSize::Small, Anchor::Centre, Colour::INK);
                }
            }
        }
        frame.legend(series.iter().map(|(name, _)| name.as_str()));
        frame.image
    }

    /// One bar per category, made of the series one on top of the other, with the sum above; values that are negative or not finite are
    /// left out.
    pub fn stacked_bars(&self, categories: &[String], series: &[(String, Vec<f64>)]) -> Image {
        let value = |s: usize, c: usize| series[s].1.get(c).copied().filter(|v| v.is_finite() && *v > 0.0).unwrap_or(0.0);
        let sum = |series: usize, c: usize| (0..series).map(|s| value(s, c)).sum::<f64>();
        let sums = (0..categories.len()).map(|c| sum(series.len(), c));
        let mut frame = Frame::new(self, sums, Horizontal::Categories(categories.iter().map(String::as_str).collect()));
        for c in 0..categories.len() {
            let (middle, step) = frame.category(c, categories.len());
            let (left, width) = ((middle - step * 0.3) as i32, ((step * 0.6) as u32).max(1));
            for s in 0..series.len() {
                let (low, high) = (frame.y(sum(s, c)), frame.y(sum(s + 1, c)));
                frame.image.rectangle(left, high, width, low.abs_diff(high), Colour::SERIES[s % Colour::SERIES.len()]);
            }
            let top = sum(series.len(), c);
            frame.image.text(&format!("{top:.2}"), middle as i32, frame.y(top) - 8, TextSize::Small, Anchor::Centre, Colour::INK);
        }
        frame.legend(series.iter().map(|(name, _)| name.as_str()));
        frame.image
    }

    /// One line per series through its points (x, y).
    pub fn lines(&self, series: &[(String, Vec<(f64, f64)>)]) -> Image {
        let plain = |points: &Vec<(f64, f64)>| points.iter().map(|p| (p.0, p.1, 0.0)).collect();
        self.weighted_lines(&series.iter().map(|(name, points)| (name.clone(), plain(points))).collect::<Vec<_>>())
    }

    /// One line per series through its points (x, y, weight), with a disc on each point whose area grows with its weight.
    pub fn weighted_lines(&self, series: &[WeightedSeries]) -> Image {
        let points = || series.iter().flat_map(|(_, points)| points.iter());
        let mut frame = Frame::new(self, points().map(|p| p.1), Horizontal::Numbers(self.x_axis(points().map(|p| p.0))));
        if self.diagonal {
            let (low, high) = (frame.x_axis.range.start.max(frame.y_axis.range.start), frame.x_axis.range.end.min(frame.y_axis.range.end));
            frame.image.line((frame.x(low), frame.y(low)), (frame.x(high), frame.y(high)), 2, Colour::FAINT);
        }
        let heaviest = points().map(|p| p.2).filter(|w| w.is_finite()).fold(0.0, f64::max);
        for (s, (_, points)) in series.iter().enumerate() {
            let colour = Colour::SERIES[s % Colour::SERIES.len()];
            let shown: Vec<_> = points.iter().filter(|p| frame.x_axis.shows(p.0) && frame.y_axis.shows(p.1)).collect();
            let places: Vec<_> = shown.iter().map(|p| (frame.x(p.0), frame.y(p.1))).collect();
            for pair in places.windows(2) {
                frame.image.line(pair[0], pair[1], 2, colour);
            }
            for (&(x, y), point) in places.iter().zip(shown).filter(|(_, point)| point.2 > 0.0) {
                let diameter = (22.0 * (point.2 / heaviest).sqrt()).max(5.0);
                frame.image.disc(x, y, diameter as u32, colour.with_opacity(0.8));
            }
        }
        frame.legend(series.iter().map(|(name, _)| name.as_str()));
        frame.image
    }

    /// The share of values up to each value (cumulative distribution), one line per series.
    pub fn cumulative(&self, series: &[(String, Vec<f64>)]) -> Image {
        let steps = |values: &Vec<f64>| {
            let mut values: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
            values.sort_by(f64::total_cmp);
            let n = values.len() as f64;
            let step = |(i, v): (usize, f64)| [(v, i as f64 / n), (v, (i + 1) as f64 / n)];
            values.into_iter().enumerate().flat_map(step).collect()
        };
        let series: Vec<_> = series.iter().map(|(name, values)| (name.clone(), steps(values))).collect();
        Self { y_range: Some(0.0..1.0), ..self.clone() }.lines(&series)
    }

    fn y_axis(&self, values: impl Iterator<Item = f64>) -> Axis {
        let log = self.y_log;
        let range = self.y_range.clone().unwrap_or_else(|| if log { decades_of(values) } else { range_of(values, true) });
        Axis { range, log }
    }

    fn x_axis(&self, values: impl Iterator<Item = f64>) -> Axis {
        let log = self.x_log;
        let range = self.x_range.clone().unwrap_or_else(|| if log { decades_of(values) } else { range_of(values, false) });
        Axis { range, log }
    }
}

/// The range of the finite values, widened where it is empty, ended at ticks.
fn range_of(values: impl Iterator<Item = f64>, with_zero: bool) -> Range<f64> {
    let start = if with_zero { (0.0, 0.0) } else { (f64::INFINITY, f64::NEG_INFINITY) };
    let (low, high) = values.filter(|v| v.is_finite()).fold(start, |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    if low == high {
        return if low == 0.0 { 0.0..1.0 } else { low - low.abs() / 2.0..low + low.abs() / 2.0 };
    }
    let step = tick_step(low, high);
    (low / step).floor() * step..(high / step).ceil() * step
}

/// A step of 1, 2 or 5 times a power of ten that gives about six ticks.
fn tick_step(low: f64, high: f64) -> f64 {
    let rough = (high - low) / 6.0;
    let power = 10.0_f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough * 0.999).unwrap_or(10.0 * power)
}

/// Ticks of an axis with their labels.
fn ticks(axis: &Range<f64>) -> Vec<(f64, String)> {
    let step = tick_step(axis.start, axis.end);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (axis.start / step - 1e-9).ceil();
    let tick = |n: i32| (first + f64::from(n)) * step;
    (0..20)
        .map(tick)
        .take_while(|t| *t <= axis.end + step * 1e-9)
        .map(|t| (t, format!("{:.decimals$}", if t == 0.0 { 0.0 } else { t })))
        .collect()
}

/// The range of the positive finite values, ended at 1, 2 or 5 times a power of ten.
fn decades_of(values: impl Iterator<Item = f64>) -> Range<f64> {
    let values = values.filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), v| (low.min(v), high.max(v)));
    if low > high {
        return 1.0..10.0;
    }
    let steps = |v: f64| {
        let power = 10.0_f64.powf(v.log10().floor());
        [1.0, 2.0, 5.0, 10.0].map(|m| m * power)
    };
    let start = steps(low).into_iter().rfind(|s| *s <= low).unwrap_or(low);
    let end = steps(high).into_iter().find(|s| *s >= high && *s > start).unwrap_or(high * 10.0);
    start..end
}

/// Ticks of a logarithmic axis: powers of ten, and where these are few also 2 and 5 times them.
fn log_ticks(axis: &Range<f64>) -> Vec<(f64, String)> {
    let decades = axis.start.log10().floor() as i32..axis.end.log10().ceil() as i32 + 1;
    let multiples: &[f64] = if decades.len() > 4 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let within = |t: &f64| *t >= axis.start * 0.999 && *t <= axis.end * 1.001;
    let label =
        |t: f64, decade: i32| if decade < -3 { format!("{t:.0e}") } else { format!("{t:.*}", decade.min(0).unsigned_abs() as usize) };
    decades
        .flat_map(|d| multiples.iter().map(move |m| (m * 10.0_f64.powi(d), d)))
        .filter(|(t, _)| within(t))
        .map(|(t, d)| (t, label(t, d)))
        .collect()
}

/// An axis of numbers.
struct Axis {
    range: Range<f64>,
    log: bool,
}

impl Axis {
    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// How far along the axis a value stands, from 0 to 1.
    fn share(&self, value: f64) -> f64 {
        let place = |v: f64| if self.log { v.ln() } else { v };
        let (low, high) = (place(self.range.start), place(self.range.end));
        ((place(value) - low) / (high - low)).clamp(0.0, 1.0)
    }

    fn ticks(&self) -> Vec<(f64, String)> {
        if self.log { log_ticks(&self.range) } else { ticks(&self.range) }
    }
}

enum Horizontal<'a> {
    Categories(Vec<&'a str>),
    Numbers(Axis),
}

/// Axes, ticks and labels, and the places of values.
struct Frame {
    image: Image,
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    x_axis: Axis,
    y_axis: Axis,
}

impl Frame {
    fn new(chart: &Chart, values: impl Iterator<Item = f64>, horizontal: Horizontal) -> Self {
        let mut image = Image::new(chart.width, chart.height);
        let y_axis = chart.y_axis(values);
        let y_ticks = y_axis.ticks();
        let label_width = y_ticks.iter().map(|(_, t)| TextSize::Small.width(t)).max().unwrap_or(0) as i32;
        let (left, right) = (34 + label_width, chart.width as i32 - 16);
        let (top, bottom) = (56, chart.height as i32 - 52);
        let (x_axis, names) = match horizontal {
            Horizontal::Numbers(axis) => (axis, None),
            Horizontal::Categories(names) => (Axis { range: 0.0..1.0, log: false }, Some(names)),
        };
        image.text(&chart.title, (left + right) / 2, 20, TextSize::Large, Anchor::Centre, Colour::INK);
        image.text(&chart.x_label, (left + right) / 2, chart.height as i32 - 14, TextSize::Medium, Anchor::Centre, Colour::INK);
        let mut label = Image::new(TextSize::Medium.width(&chart.y_label) + 2, TextSize::Medium.height() + 2);
        label.text(&chart.y_label, 1, label.height() as i32 / 2, TextSize::Medium, Anchor::Left, Colour::INK);
        let turned = label.turned();
        image.paste(&turned, 6, ((top + bottom) as usize / 2).saturating_sub(turned.height() / 2));

        let mut frame = Self { image, left, right, top, bottom, x_axis, y_axis };
        for (value, text) in y_ticks {
            let y = frame.y(value);
            frame.image.line((left, y), (right, y), 1, Colour::FAINT);
            frame.image.text(&text, left - 6, y, TextSize::Small, Anchor::Right, Colour::INK);
        }
        match names {
            None => {
                for (value, text) in frame.x_axis.ticks() {
                    let x = frame.x(value);
                    frame.image.line((x, bottom), (x, bottom + 4), 1, Colour::INK);
                    frame.image.text(&text, x, bottom + 14, TextSize::Small, Anchor::Centre, Colour::INK);
                }
            }
            Some(names) => {
                // Names that would run into each other stand on two levels.
                let step = (right - left) as usize / names.len().max(1);
                let is_tight = names.iter().any(|n| TextSize::Small.width(n) + 6 > step);
                for (c, name) in names.iter().enumerate() {
                    let (x, level) = (frame.category(c, names.len()).0 as i32, if is_tight { c as i32 % 2 * 13 } else { 0 });
                    frame.image.text(name, x, bottom + 12 + level, TextSize::Small, Anchor::Centre, Colour::INK);
                }
            }
        }
        frame.image.line((left, bottom), (right, bottom), 1, Colour::INK);
        frame.image.line((left, top), (left, bottom), 1, Colour::INK);
        frame
    }

    /// Middle and width of a category's place.
    fn category(&self, index: usize, count: usize) -> (f64, f64) {
        let step = f64::from(self.right - self.left) / count.max(1) as f64;
        (f64::from(self.left) + (index as f64 + 0.5) * step, step)
    }

    fn x(&self, value: f64) -> i32 {
        self.left + (self.x_axis.share(value) * f64::from(self.right - self.left)).round() as i32
    }

    fn y(&self, value: f64) -> i32 {
        self.bottom - (self.y_axis.share(value) * f64::from(self.bottom - self.top)).round() as i32
    }

    /// Names of the series in a line above the plot, at the right; unnamed ones are left out.
    fn legend<'a>(&mut self, names: impl Iterator<Item = &'a str>) {
        let names: Vec<_> = names.enumerate().filter(|(_, name)| !name.is_empty()).collect();
        let (mut x, y) = (self.right, self.top - 14);
        for (s, name) in names.into_iter().rev() {
            x -= TextSize::Small.width(name) as i32;
            self.image.text(name, x, y, TextSize::Small, Anchor::Left, Colour::INK);
            self.image.rectangle(x - 16, y - 5, 10, 10, Colour::SERIES[s % Colour::SERIES.len()]);
            x -= 30;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_over_the_whole_axis() {
        let labels = |low, high| ticks(&range_of([low, high].into_iter(), false)).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(-3.0, 41.0), ["-10", "0", "10", "20", "30", "40", "50"]);
        assert_eq!(labels(0.0, 0.0123), ["0.000", "0.005", "0.010", "0.015"]);
        assert_eq!(range_of([f64::NAN].into_iter(), false), 0.0..1.0);
        assert_eq!(range_of([4.0].into_iter(), false), 2.0..6.0);
    }

    #[test]
    fn ticks_of_a_logarithmic_axis_are_powers_of_ten_and_where_few_their_multiples() {
        let labels = |low, high| log_ticks(&decades_of([low, high].into_iter())).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(0.3, 7.0), ["0.2", "0.5", "1", "2", "5", "10"]);
        assert_eq!(labels(0.002, 900.0), ["0.01", "0.1", "1", "10", "100", "1000"]);
        assert_eq!(decades_of([0.0, f64::NAN, -1.0].into_iter()), 1.0..10.0);
        assert_eq!(decades_of([2.0].into_iter()), 2.0..5.0);
    }

    #[test]
    fn values_stand_where_the_axis_says() {
        let axis = |range, log| Axis { range, log };
        let frame = Frame::new(&Chart::new("", "", ""), [10.0].into_iter(), Horizontal::Numbers(axis(0.0..2.0, false)));
        assert_eq!((frame.y(0.0), frame.y(10.0), frame.y(5.0)), (frame.bottom, frame.top, (frame.top + frame.bottom) / 2));
        assert_eq!((frame.x(0.0), frame.x(2.0), frame.x(9.0)), (frame.left, frame.right, frame.right));
        let chart = Chart { y_log: true, ..Chart::new("", "", "") };
        let frame = Frame::new(&chart, [0.01, 100.0, -3.0].into_iter(), Horizontal::Numbers(axis(0.1..10.0, true)));
        assert_eq!((frame.y(0.01), frame.y(100.0), frame.y(1.0)), (frame.bottom, frame.top, (frame.top + frame.bottom) / 2));
        assert_eq!((frame.x(0.1), frame.x(10.0)), (frame.left, frame.right));
        assert!((frame.x(1.0) - (frame.left + frame.right) / 2).abs() <= 1);
    }

    #[test]
    fn stacked_bars_stand_on_each_other() {
        let chart = Chart { y_range: Some(0.0..4.0), ..Chart::new("", "", "") };
        let image = chart.stacked_bars(&["a".into()], &[("".into(), vec![1.0]), ("".into(), vec![2.0])]);
        let frame = Frame::new(&chart, [].into_iter(), Horizontal::Categories(vec!["a"]));
        let middle = frame.category(0, 1).0 as usize;
        let at = |value: f64| image.pixel(middle, frame.y(value) as usize);
        assert_eq!([at(0.5), at(1.5), at(2.5)], [Colour::SERIES[0].rgb, Colour::SERIES[1].rgb, Colour::SERIES[1].rgb]);
        assert_eq!(at(3.5), Colour::PAPER.rgb);
    }

    #[test]
    fn odd_data_draw_without_panicking() {
        let chart = Chart::new("empty", "", "");
        chart.strips(&[]);
        chart.strips(&[("a".into(), vec![]), ("b".into(), vec![f64::NAN, f64::INFINITY, 1e300])]);
        chart.bars(&[], &[]);
        chart.bars(&["a".into()], &[("s".into(), vec![-1.0, 2.0]), ("t".into(), vec![])]);
        chart.lines(&[("s".into(), vec![(f64::NAN, 1.0), (1.0, 1.0)])]);
        chart.cumulative(&[("s".into(), vec![])]);
        chart.stacked_bars(&[], &[]);
        chart.stacked_bars(&["a".into()], &[("s".into(), vec![f64::NAN]), ("t".into(), vec![-1.0]), ("u".into(), vec![])]);
        let log = Chart { x_log: true, y_log: true, diagonal: true, ..chart.clone() };
        log.weighted_lines(&[("s".into(), vec![(0.0, -1.0, 1.0), (1.0, 0.0, f64::NAN), (2.0, 5.0, 2.0)])]);
        log.bars(&["a".into()], &[("s".into(), vec![0.5])]);
        Chart { width: 10, height: 10, ..chart }.bars(&["a".into()], &[("s".into(), vec![1.0])]);
    }

    #[test]
    #[ignore = "writes pictures for a person to look at: set BEO_PICTURES to a folder"]
    fn charts_to_look_at() {
        let Some(folder) = std::env::var_os("BEO_PICTURES") else { return };
        let classes = beo_core::furniture::CLASSES;
        let spread = |c: usize| (0..50).map(|n| 12.0 + c as f64 + 9.0 * ((n * n + 7 * c) as f64 * 0.37).sin()).collect::<Vec<_>>();
        let strips: Vec<_> = classes.iter().enumerate().map(|(c, name)| (name.to_string(), spread(c))).collect();
        let two: Vec<_> = ["hull", "paper"].iter().enumerate().map(|(s, n)| (n.to_string(), spread(4 * s))).collect();
        let shares = |s: f64| (0..10).map(|c| 0.7 + 0.03 * (f64::from(c) * s).sin()).collect::<Vec<_>>();
        let names: Vec<_> = classes.iter().map(|c| c.to_string()).collect();
        let chart = |title| Chart::new(title, "class", "Euclidean error");
        let rows = [
            vec![(chart("Completion error").strips(&strips), String::new())],
            vec![(Chart::new("Query time", "ms", "share of queries").cumulative(&two), "".into())],
            vec![(chart("Accuracy").bars(&names, &[("hull".into(), shares(1.0)), ("paper".into(), shares(2.0))]), "".into())],
        ];
        crate::sheet(&rows, "Charts").save(&std::path::Path::new(&folder).join("charts.png")).unwrap();
    }
}
