//! The figures as pictures: how late the latest are, and where the time goes.

use super::{LoadReport, Report};
use beo_picture::{Chart, SaveError, sheet};
use std::path::Path;

/// Points of a curve for each factor of ten.
const POINTS: f64 = 40.0;

/// Draws `latency.png` and `stages.png` into a folder that exists.
///
/// # Errors
/// [`SaveError`] if a picture cannot be written.
pub fn save(folder: &Path, report: &Report) -> Result<(), SaveError> {
    let about = format!("{} classes, {}, {} runs of {} s", report.classes, report.dims, report.settings.repeat, report.settings.seconds);
    let series: Vec<_> = report.loads.iter().map(|load| (load.load.to_owned(), tail(load))).collect();
    let chart = Chart::new(&format!("Latency: {about}"), "milliseconds, logarithmic", "share that is slower, logarithmic");
    Chart { x_log: true, y_log: true, ..chart }.lines(&series).save(&folder.join("latency.png"))?;

    let names: Vec<String> = report.loads.iter().map(|load| load.load.to_owned()).collect();
    let stages: Vec<(String, Vec<f64>)> = report.stages[1..]
        .iter()
        .enumerate()
        .map(|(stage, name)| (name.to_string(), report.loads.iter().map(|load| load.stages_us[stage].took.p50 / 1e3).collect()))
        .collect();
    // As times and as shares: next to a load that waits, nothing is seen of one that does not.
    let chart = |y: &str| Chart { width: 960, height: 360, ..Chart::new("", "load", y) };
    let shares = Chart { y_range: Some(0.0..112.0), ..chart("percent") }.stacked_bars(&names, &shares(&stages));
    let rows = [vec![(chart("milliseconds").stacked_bars(&names, &stages), String::new())], vec![(shares, String::new())]];
    sheet(&rows, &format!("Stages, medians: {about}")).save(&folder.join("stages.png"))
}

/// Each stage's percentage of the sum of all stages, for each load.
fn shares(stages: &[(String, Vec<f64>)]) -> Vec<(String, Vec<f64>)> {
    let sum = |load: usize| stages.iter().map(|(_, times)| times[load]).sum::<f64>();
    stages
        .iter()
        .map(|(name, times)| (name.clone(), times.iter().enumerate().map(|(load, time)| 100.0 * time / sum(load)).collect()))
        .collect()
}

/// Latency in milliseconds and the share of observations that are slower, down to the slowest one.
fn tail(load: &LoadReport) -> Vec<(f64, f64)> {
    let count = load.all.len();
    let steps = ((count as f64).log10() * POINTS).floor() as u32;
    let point = |step: u32| {
        let share = 10.0_f64.powf(-f64::from(step) / POINTS);
        (load.all.value_at_quantile(1.0 - share) as f64 / 1e6, share)
    };
    if count == 0 { Vec::new() } else { (0..=steps).map(point).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::latency::{Load, summary::Run};
    use crate::benchmark::percentiles::histogram;

    #[test]
    fn shares_are_of_each_load() {
        let stages = [("a".to_owned(), vec![1.0, 30.0]), ("b".to_owned(), vec![3.0, 10.0])];
        assert_eq!(shares(&stages), [("a".to_owned(), vec![25.0, 75.0]), ("b".to_owned(), vec![75.0, 25.0])]);
    }

    #[test]
    fn the_tail_reaches_to_the_slowest() {
        let run = Run { sent: Default::default(), readers: vec![] };
        let mut load = LoadReport::new(Load::Steady, &[run]);
        assert!(tail(&load).is_empty());
        load.all = histogram((1..=1000).map(|ms| ms * 1_000_000));
        let points = tail(&load);
        assert_eq!(points.len(), 121);
        assert!(points.is_sorted_by(|a, b| a.0 <= b.0 && a.1 > b.1));
        assert!((points[40].0 - 900.0).abs() < 2.0 && (points[120].1 - 1e-3).abs() < 1e-9);
    }
}
