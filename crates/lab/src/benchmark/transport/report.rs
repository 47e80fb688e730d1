//! The measurement of transports: medians over the repeats, ratios, text and chart.

use super::plan::{Exchange, Plan, Wake, Way, Work, bytes};
use crate::benchmark::machine::Circumstances;
use crate::benchmark::percentiles::{Percentiles, median_ratio};
use beo_picture::{Chart, Image, sheet};
use serde::Serialize;
use std::fmt::Write;

/// One kind of hand-over of grids of one size.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// Side of the cubic grid, voxels.
    pub side: u32,
    /// Its bytes.
    pub bytes: usize,
    /// How it was handed over.
    #[serde(flatten)]
    pub exchange: Exchange,
    /// Medians over the repeats, microseconds.
    pub us: Percentiles,
    /// The median of each repeat, microseconds.
    pub p50_of_repeats_us: Vec<f64>,
}

/// A ratio of medians measured in the same repeats.
#[derive(Clone, Debug, Serialize)]
pub struct Ratio {
    /// Numerator and denominator.
    pub what: String,
    /// One value per size.
    pub by_size: Vec<f64>,
}

/// Everything.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Which benchmark.
    pub benchmark: &'static str,
    /// On which machine, and how far to trust it.
    #[serde(flatten)]
    pub circumstances: Circumstances,
    /// Whether sender and reader had a core each.
    pub pinned: bool,
    /// The requested measurement.
    pub plan: Plan,
    /// The measured values, by size.
    pub cells: Vec<Cell>,
    /// The ratios that the times come down to.
    pub ratios: Vec<Ratio>,
}

impl Report {
    /// Of the percentiles of the steps of `plan`, in its order.
    pub fn new(circumstances: Circumstances, pinned: bool, plan: &Plan, measured: &[Percentiles]) -> Self {
        let of = |grid: usize, exchange: Exchange| -> Vec<Percentiles> {
            let steps = plan.steps().zip(measured);
            steps.filter(|(step, _)| step.grid == grid && step.exchange == exchange).map(|(_, p)| *p).collect()
        };
        let grids = || plan.sides.iter().copied().enumerate();
        let cells: Vec<Cell> = grids()
            .flat_map(|(grid, side)| Exchange::ALL.map(|exchange| (side, exchange, of(grid, exchange))))
            .map(|(side, exchange, repeats)| Cell {
                side,
                bytes: bytes(side),
                exchange,
                us: Percentiles::median(&repeats),
                p50_of_repeats_us: repeats.iter().map(|p| p.p50).collect(),
            })
            .collect();
        let mut report = Self { benchmark: "transport", circumstances, pinned, plan: plan.clone(), cells, ratios: Vec::new() };
        report.ratios = report.all_ratios();
        report
    }

    fn medians(&self, grid: usize, exchange: Exchange) -> &[f64] {
        let side = self.plan.sides[grid];
        let cell = self.cells.iter().find(|cell| cell.side == side && cell.exchange == exchange);
        cell.map_or(&[], |cell| &cell.p50_of_repeats_us)
    }

    fn all_ratios(&self) -> Vec<Ratio> {
        let sizes = 0..self.plan.sides.len();
        let by_size = |what: String, of: &dyn Fn(usize) -> f64| Ratio { what, by_size: sizes.clone().map(of).collect() };
        let ours = |work, wake| Exchange { way: Way::Ours, work, wake };
        let over = |above: Exchange, below: Exchange| {
            by_size(format!("{} / {}", label(above), label(below)), &|grid| {
                median_ratio(self.medians(grid, above), self.medians(grid, below))
            })
        };
        let raw = |exchange: Exchange| over(exchange, Exchange { way: Way::Raw, ..exchange });
        let (polled, woken, read) = (ours(Work::Pointer, Wake::Polling), ours(Work::Pointer, Wake::Event), ours(Work::Sum, Wake::Event));
        let growth = |exchange| {
            by_size(format!("{}, by size / of the smallest", label(exchange)), &|grid| {
                median_ratio(self.medians(grid, exchange), self.medians(0, exchange))
            })
        };
        vec![
            raw(polled),
            raw(woken),
            raw(read),
            over(polled, Exchange { way: Way::Local, ..polled }),
            over(woken, Exchange { way: Way::Local, ..woken }),
            growth(polled),
            growth(woken),
            over(Exchange { way: Way::Socket, ..read }, read),
            over(Exchange { way: Way::Pipe, ..read }, read),
            over(ours(Work::Validate, Wake::Event), read),
        ]
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.circumstances.machine);
        let place = if self.pinned { "a core each" } else { "sharing what cores there are" };
        let Plan { messages, repeats, .. } = &self.plan;
        let _ =
            writeln!(text, "two processes, {place}; {messages} hand-overs a kind (fewer of big payloads), {repeats} repeats, medians\n");
        let _ = writeln!(text, "{:<36} {:>9} {:>9} {:>9} {:>9}   p50 of the repeats", "microseconds", "bytes", "p50", "p90", "p99");
        for cell in &self.cells {
            let (low, high) = cell.p50_of_repeats_us.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), p| (low.min(*p), high.max(*p)));
            let (name, p) = (label(cell.exchange), cell.us);
            let times = format!("{:>9.2} {:>9.2} {:>9.2}", p.p50, p.p90, p.p99);
            let _ = writeln!(text, "{name:<36} {:>9} {times}   {low:.2} to {high:.2}", cell.bytes);
        }
        let sizes: String = self.plan.sides.iter().map(|side| format!(" {:>9}", bytes(*side))).collect();
        let _ = writeln!(text, "\n{:<72}{sizes}", "ratios of medians, by bytes");
        for ratio in &self.ratios {
            let values: String = ratio.by_size.iter().map(|value| format!(" {value:>9.2}")).collect();
            let _ = writeln!(text, "{:<72}{values}", ratio.what);
        }
        text.push_str(&self.circumstances.warning_lines());
        text
    }

    /// Two charts: the pointer alone, and the payload written and read.
    pub fn chart(&self) -> Image {
        let sizes: Vec<String> = self.plan.sides.iter().map(|side| format!("{} bytes ({side}³)", bytes(*side))).collect();
        let chart = |title: &str, pointer: bool| {
            let chosen = Exchange::ALL.into_iter().filter(|e| (e.work == Work::Pointer) == pointer);
            let series: Vec<(String, Vec<f64>)> = chosen
                .map(|exchange| {
                    let values = self.cells.iter().filter(|cell| cell.exchange == exchange).map(|cell| cell.us.p50);
                    (short(exchange), values.collect())
                })
                .collect();
            Chart { y_log: true, width: 1100, ..Chart::new(title, "", "median, µs") }.bars(&sizes, &series)
        };
        let charts = [chart("Hand-over of the pointer", true), chart("Payload written and read", false)];
        sheet(&charts.map(|chart| vec![(chart, String::new())]), "")
    }
}

fn name(way: Way) -> &'static str {
    match way {
        Way::Ours => "ours",
        Way::Raw => "iceoryx2",
        Way::Local => "iceoryx2, no lock",
        Way::Socket => "socket",
        Way::Pipe => "pipe",
    }
}

fn label(exchange: Exchange) -> String {
    let work = match exchange.work {
        Work::Pointer => "pointer",
        Work::Sum => "written and read",
        Work::Validate => "written, checked and copied",
    };
    let wake = if exchange.wake == Wake::Polling { ", polling" } else { "" };
    format!("{}: {work}{wake}", name(exchange.way))
}

fn short(exchange: Exchange) -> String {
    let name = name(exchange.way);
    match (exchange.work, exchange.wake) {
        (Work::Pointer, Wake::Polling) => format!("{name}, polling"),
        (Work::Pointer, Wake::Event) => format!("{name}, event"),
        (Work::Sum, _) => name.to_owned(),
        (Work::Validate, _) => format!("{name}, checked and copied"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::machine::Watch;

    #[test]
    fn ratios_compare_what_was_measured_in_the_same_repeat() {
        let plan = Plan { sides: vec![30, 64], messages: 1, repeats: 3 };
        // Raw takes 10 + size; ours half as much again; the second repeat is slow for all.
        let measured: Vec<Percentiles> = plan
            .steps()
            .map(|step| {
                let us = (10 + step.grid) as f64 * if step.exchange.way == Way::Ours { 1.5 } else { 1.0 } * [1.0, 7.0, 1.0][step.repeat];
                Percentiles { p50: us, ..Percentiles::default() }
            })
            .collect();
        let report = Report::new(Watch::start().end(), true, &plan, &measured);
        assert_eq!(report.cells.len(), 2 * Exchange::ALL.len());
        assert!(report.ratios[..3].iter().all(|ratio| ratio.by_size == [1.5, 1.5]), "{:?}", report.ratios);
        assert!((report.ratios[5].by_size[1] - 1.1).abs() < 1e-12);
        assert!((report.ratios[7].by_size[0] - 1.0 / 1.5).abs() < 1e-12);
        let text = report.text();
        assert!(text.contains("ours: pointer, polling / iceoryx2: pointer, polling"), "{text}");
        assert!(report.chart().width() > 100);
    }
}
