//! The figures as text.

use super::{LoadReport, Report};
use crate::benchmark::percentiles::NAMED;
use std::fmt::Write;

/// Machine, counts, latencies by load, stages by load, and what to doubt.
pub fn text(report: &Report) -> String {
    let mut out = String::new();
    describe(report, &mut out);
    // What was not answered first: percentiles of the others say little where it is much.
    counts(report, &mut out);
    latencies(report, &mut out);
    stages(report, &mut out);
    out.push_str(&report.circumstances.warning_lines());
    out
}

/// Writing to a text cannot fail.
fn line(out: &mut String, text: std::fmt::Arguments<'_>) {
    let _ = writeln!(out, "{text}");
}

fn describe(report: &Report, out: &mut String) {
    let (settings, cores) = (&report.settings, &report.cores);
    line(out, format_args!("{}", report.circumstances.machine));
    line(out, format_args!("model {}: {} classes, {}", settings.model.display(), report.classes, report.dims));
    line(
        out,
        format_args!(
            "pose {}, wake-up by {}, {} × {} s after a warm-up of half a second, each with fresh processes: medians of the runs",
            name(&settings.pose),
            name(&settings.wake),
            settings.repeat,
            settings.seconds
        ),
    );
    line(out, format_args!("cores: daemon {:?}, producer {:?}, readers {:?}", cores.daemon, cores.producer, cores.readers));
    report.shared.iter().for_each(|shared| line(out, format_args!("       {shared}")));
    line(out, format_args!(""));
}

/// The name that it has in JSON.
fn name(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

fn latencies(report: &Report, out: &mut String) {
    let mut heading = format!("{:<26}{:>8}", "latency, ms", "answers");
    NAMED.iter().for_each(|(name, _)| heading.push_str(&format!("{name:>10}")));
    line(out, format_args!("{heading}{:>10}", "max"));
    for load in &report.loads {
        let grids = load.frame_to_grids_us.as_ref().map(|percentiles| (" frame to grids", percentiles));
        for (what, percentiles) in [("", &load.latency_us), (" from the write", &load.from_write_us)].into_iter().chain(grids) {
            let values: String = percentiles.values().iter().map(|us| format!("{:>10.3}", us / 1e3)).collect();
            line(out, format_args!("{:<26}{:>8}{values}", format!("{}{what}", load.load), percentiles.count));
        }
    }
    for load in &report.loads {
        line(out, format_args!("{}: from {}", load.load, load.measured_from));
    }
    if report.settings.repeat > 1 {
        line(out, format_args!("medians of single runs differ by a factor of up to {:.2}", report.spread()));
    }
    if report.is_short() {
        line(out, format_args!("p99.99 needs 10000 answers in a run; with fewer it is the maximum"));
    }
    line(out, format_args!(""));
}

fn stages(report: &Report, out: &mut String) {
    let heading: String = report.loads.iter().map(|load| format!("{:>14}", load.load)).collect();
    line(out, format_args!("{:<26}{heading}", "median of a stage, µs"));
    for (stage, pair) in report.stages.windows(2).enumerate() {
        let value = |load: &LoadReport| format!("{:>14.1}", load.stages_us[stage].took.p50);
        let values: String = report.loads.iter().map(value).collect();
        line(out, format_args!("{:<26}{values}", format!("{} to {}", pair[0], pair[1])));
    }
    line(
        out,
        format_args!("due to laid is finding the support plane and laying the grids of a depth image, laid to written their carving"),
    );
    line(out, format_args!("received to projected includes waiting for observations that came before"));
    line(out, format_args!(""));
}

fn counts(report: &Report, out: &mut String) {
    line(
        out,
        format_args!(
            "{:<12}{:>8}{:>9}{:>7}{:>11}{:>9}{:>10}   read, missed by reader",
            "observations", "sent", "warm-up", "lost", "overtaken", "refused", "answered"
        ),
    );
    for load in &report.loads {
        let c = &load.counts;
        let readers: Vec<String> = c.read.iter().zip(&c.missed).map(|(read, missed)| format!("{read}, {missed}")).collect();
        let sums = if c.sums_match { "sums match" } else { "SUMS DO NOT MATCH" };
        line(
            out,
            format_args!(
                "{:<12}{:>8}{:>9}{:>7}{:>11}{:>9}{:>10}   {}; {sums}",
                load.load,
                c.sent,
                c.warm_up,
                c.lost,
                c.overtaken,
                c.refused,
                c.answered,
                readers.join("; ")
            ),
        );
    }
    line(out, format_args!(""));
}
