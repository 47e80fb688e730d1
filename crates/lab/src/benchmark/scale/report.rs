//! Series as a table and as a chart.

use super::growth::{Line, Series};
use beo_picture::{Chart, Image};
use std::fmt::Write;

/// A table: sizes across, stages down, medians, then the exponent that fits and the one to be expected.
pub fn table(series: &Series) -> String {
    let mut text = format!("{} ({})\n", series.name, series.setting);
    let Some(first) = series.lines.first() else { return text };
    let label = |line: &Line| format!("{}, {}", line.name, line.unit);
    let width = series.lines.iter().map(|line| label(line).chars().count()).max().unwrap_or(0).max("median".len());
    let _ = write!(text, "  {:width$}", "median");
    text.extend(first.points.iter().map(|(size, _)| format!("{:>10}", rounded(*size))));
    let _ = writeln!(text, "{:>10}{:>10}", "exponent", "expected");
    for line in &series.lines {
        let _ = write!(text, "  {:width$}", label(line));
        text.extend(line.points.iter().map(|(_, time)| format!("{:>10}", rounded(*time))));
        let _ = writeln!(text, "{:>10}{:>10}", exponent(line), line.expected);
    }
    let _ = writeln!(text, "  {}", series.why);
    text
}

/// Measurements over sizes, both logarithmic: a power law is a straight line.
pub fn chart(series: &Series) -> Image {
    let alike = series.lines.windows(2).all(|pair| pair[0].unit == pair[1].unit);
    let unit = if alike { "microseconds" } else { "in the units named" };
    let chart = Chart::new(&format!("How it grows: {}", series.name), &format!("{} ({})", series.name, series.setting), unit);
    let label = |line: &Line| if alike { line.name.clone() } else { format!("{}, {}", line.name, line.unit) };
    let lines: Vec<_> = series.lines.iter().map(|line| (format!("{}: {}", label(line), exponent(line)), line.points.clone())).collect();
    Chart { width: 860, x_log: true, y_log: true, ..chart }.lines(&lines)
}

fn exponent(line: &Line) -> String {
    line.exponent.map_or("-".into(), |e| format!("{e:.2}"))
}

/// Three digits.
fn rounded(value: f64) -> String {
    let digits = if value > 0.0 { (2 - value.log10().floor() as i32).clamp(0, 3) as usize } else { 0 };
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_sizes_times_and_exponents() {
        let line = Line::new("class", 3.0, vec![(2.0, 40.0), (4.0, 80.0), (8.0, 160.0)]);
        let once = Line::new("completion", 0.0, vec![(2.0, 1234.5)]);
        let series = Series { name: "classes".into(), setting: "30³".into(), why: "because".into(), lines: vec![line, once] };
        let text = table(&series);
        let words = |line: usize| text.lines().nth(line).unwrap().split_whitespace().collect::<Vec<_>>();
        assert_eq!(words(1), ["median", "2", "4", "8", "exponent", "expected"]);
        assert_eq!(words(2), ["class,", "µs", "40", "80", "160", "1.00", "3"]);
        assert_eq!(words(3), ["completion,", "µs", "1234", "-", "0"]);
        assert_eq!(chart(&series).width(), 860);
    }

    #[test]
    fn numbers_are_rounded_to_three_digits() {
        assert_eq!([0.05, 0.123456, 2.0, 45.678, 1234.4, 0.0].map(rounded), ["0.05", "0.123", "2", "45.7", "1234", "0"]);
    }
}
