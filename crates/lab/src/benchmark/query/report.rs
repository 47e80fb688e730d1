//! The measurement of queries: medians over the repeats, ratios, text.

use super::floor::Floor;
use super::peers::Agreement;
use super::questions::Search;
use super::timing::{Condition, Task};
use crate::benchmark::limits::Limits;
use crate::benchmark::machine::Circumstances;
use crate::benchmark::percentiles::{Percentiles, median_ratio};
use serde::Serialize;
use std::fmt::Write;

/// Our own queries of one kind.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// A name that no other row has.
    pub name: String,
    /// The prior knowledge of the pose.
    pub search: Search,
    /// The tasks of the queries.
    pub task: Task,
    /// The activity before each query.
    pub condition: Condition,
    /// Medians over the repeats, microseconds.
    pub us: Percentiles,
    /// The median of each repeat, microseconds.
    pub p50_of_repeats_us: Vec<f64>,
    /// The data read and operations computed at least, mean over the queries.
    pub floor: Floor,
    /// Median over the time that reading it takes: from the shared cache when warm, else from memory.
    pub over_bandwidth: f64,
    /// Median over the time that computing it takes at the rate of matrix products.
    pub over_gflops: f64,
}

impl Row {
    /// Of the percentiles of each repeat.
    pub fn new(search: Search, task: Task, condition: Condition, repeats: &[Percentiles], floor: Floor, limits: &Limits) -> Self {
        let us = Percentiles::median(repeats);
        let gb_s = if condition == Condition::Warm { limits.cache_gb_s } else { limits.memory_gb_s };
        let task_name = if task == Task::Class { "class" } else { "class and completion" };
        Self {
            name: format!("{}, {task_name}, {}", search.name(), condition.name()),
            search,
            task,
            condition,
            us,
            p50_of_repeats_us: repeats.iter().map(|p| p.p50).collect(),
            floor,
            // GB/s are thousands of bytes per microsecond.
            over_bandwidth: us.p50 / (floor.bytes / gb_s / 1e3),
            over_gflops: us.p50 / (floor.flops / limits.gflops / 1e3),
        }
    }
}

/// Someone else's answers to the same queries.
#[derive(Clone, Debug, Serialize)]
pub struct PeerRow {
    /// Who.
    pub name: String,
    /// Threads that it may use.
    pub threads: usize,
    /// Medians over the repeats, microseconds.
    pub us: Percentiles,
    /// The median of each repeat, microseconds.
    pub p50_of_repeats_us: Vec<f64>,
    /// The row of ours that it is compared with.
    pub ours: String,
    /// Its median over ours, of the same repeat.
    pub over_ours: f64,
    /// How far its answers agree with ours, where they can.
    pub agreement: Option<Agreement>,
    /// Whether they are the same up to rounding.
    pub same_answers: Option<bool>,
}

impl PeerRow {
    /// Of the percentiles of each repeat.
    pub fn new(name: &str, threads: usize, repeats: &[Percentiles], ours: &Row, agreement: Option<Agreement>) -> Self {
        let p50_of_repeats_us: Vec<f64> = repeats.iter().map(|p| p.p50).collect();
        Self {
            name: name.to_owned(),
            threads,
            us: Percentiles::median(repeats),
            ours: ours.name.clone(),
            over_ours: median_ratio(&p50_of_repeats_us, &ours.p50_of_repeats_us),
            p50_of_repeats_us,
            same_answers: agreement.as_ref().map(Agreement::is_equal),
            agreement,
        }
    }
}

/// Everything.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Which benchmark.
    pub benchmark: &'static str,
    /// On which machine, and how far to trust it.
    #[serde(flatten)]
    pub circumstances: Circumstances,
    /// How fast it can go at most.
    pub limits: Limits,
    /// The questions, for people.
    pub about: String,
    /// Different queries of each kind.
    pub queries: usize,
    /// Rounds over everything.
    pub repeats: usize,
    /// Ours.
    pub rows: Vec<Row>,
    /// Others.
    pub peers: Vec<PeerRow>,
    /// The parts left out, and why.
    pub skipped: Vec<String>,
}

impl Report {
    /// For people.
    pub fn text(&self) -> String {
        let l = &self.limits;
        let mut text = format!("{}\n", self.circumstances.machine);
        let _ = writeln!(
            text,
            "{}; {} queries of each kind, {} repeats in turns, medians, {} threads",
            self.about, self.queries, self.repeats, l.threads
        );
        let _ = writeln!(
            text,
            "limits, {} threads (one): products of f32 matrices {:.0} ({:.0}) GFLOP/s, memory {:.1} ({:.1}) GB/s, shared cache {:.1} GB/s\n",
            l.threads, l.gflops, l.gflops_one, l.memory_gb_s, l.memory_gb_s_one, l.cache_gb_s
        );
        let _ = writeln!(
            text,
            "{:<48} {:>8} {:>8} {:>8} {:>9} {:>11} {:>10}",
            "milliseconds", "p50", "p90", "p99", "must read", "/ bandwidth", "/ GFLOP/s"
        );
        for row in &self.rows {
            let p = row.us;
            let _ = writeln!(
                text,
                "{:<48} {:>8.3} {:>8.3} {:>8.3} {:>6.2} MB {:>10.1}x {:>9.1}x",
                row.name,
                p.p50 / 1e3,
                p.p90 / 1e3,
                p.p99 / 1e3,
                row.floor.bytes / 1e6,
                row.over_bandwidth,
                row.over_gflops
            );
        }
        if !self.peers.is_empty() {
            let _ = writeln!(
                text,
                "\n{:<48} {:>8} {:>8} {:>8} {:>8} {:>9}   ours",
                "peers, milliseconds", "p50", "p90", "p99", "threads", "/ ours"
            );
        }
        for peer in &self.peers {
            let p = peer.us;
            let times = format!("{:>8.2} {:>8.2} {:>8.2}", p.p50 / 1e3, p.p90 / 1e3, p.p99 / 1e3);
            let _ = writeln!(text, "{:<48} {times} {:>8} {:>8.1}x   {}", peer.name, peer.threads, peer.over_ours, peer.ours);
        }
        for (peer, agreement) in self.peers.iter().filter_map(|peer| Some((peer, peer.agreement?))) {
            let Agreement { queries, same_class, posterior, occupancy, deviation } = agreement;
            let verdict = if agreement.is_equal() { "the same answers" } else { "other answers" };
            let _ = writeln!(
                text,
                "{}: {verdict}: same class in {same_class} of {queries}, posteriors differ by {posterior:.1e} at most, completions by {occupancy:.1e}, deviations by {deviation:.1e}",
                peer.name
            );
        }
        for line in &self.skipped {
            let _ = writeln!(text, "skipped: {line}");
        }
        text.push_str(&self.circumstances.warning_lines());
        text
    }
}
