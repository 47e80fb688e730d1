//! Figures of one run, of several, and of all.

use super::producer::Sent;
use super::record::{Record, STAGES};
use super::{Load, Settings, Wake};
use crate::benchmark::cores::Cores;
use crate::benchmark::machine::Circumstances;
use crate::benchmark::percentiles::{Percentiles, histogram, median};
use beo_core::model::Model;
use hdrhistogram::Histogram;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// The measurement of one run.
pub struct Run {
    /// As producer and daemon counted.
    pub sent: Sent,
    /// The notes of each reader.
    pub readers: Vec<Vec<Record>>,
}

/// Where every observation went. Sums over the runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Observations sent.
    pub sent: u64,
    /// Of these, during the warm-up: in all counts but not in the times.
    pub warm_up: u64,
    /// Of these, replaced in shared memory before the daemon took them.
    pub lost: u64,
    /// Taken by the daemon.
    pub received: u64,
    /// Of these, replaced by a newer one of the same object while they waited.
    pub overtaken: u64,
    /// Of these, refused.
    pub refused: u64,
    /// Of these, answered.
    pub answered: u64,
    /// Percepts that each reader got, refusals included.
    pub read: Vec<u64>,
    /// Percepts that each reader missed because it read too late.
    pub missed: Vec<u64>,
    /// Percepts read twice: 0.
    pub repeated: u64,
    /// Percepts with a stage that ended before the one before it: 0.
    pub out_of_order: u64,
    /// Answers without a completion.
    pub incomplete: u64,
    /// Whether sent = lost + received, received = overtaken + refused + answered, and for each reader refused + answered = read + missed.
    pub sums_match: bool,
}

impl Counts {
    /// Of one run: producer, daemon and readers counted on their own.
    fn of(run: &Run) -> Self {
        let Sent { sent, warm_up, received, answered, overtaken, refused } = run.sent;
        let published = answered + refused;
        let all = || run.readers.iter().flatten();
        let distinct = |records: &Vec<Record>| {
            let mut sequences: Vec<u64> = records.iter().map(|record| record.sequence).collect();
            sequences.sort_unstable();
            sequences.dedup();
            sequences.len() as u64
        };
        let read: Vec<u64> = run.readers.iter().map(distinct).collect();
        Self {
            sent,
            warm_up,
            lost: sent.saturating_sub(received),
            received,
            overtaken,
            refused,
            answered,
            missed: read.iter().map(|read| published.saturating_sub(*read)).collect(),
            repeated: all().count() as u64 - read.iter().sum::<u64>(),
            out_of_order: all().filter(|record| record.is_complete() && !record.is_in_order()).count() as u64,
            incomplete: all().filter(|record| record.status == 0 && !record.is_complete()).count() as u64,
            sums_match: sent >= received && received == overtaken + published && read.iter().all(|read| *read <= published),
            read,
        }
    }

    fn add(mut self, other: Self) -> Self {
        let each = |ours: &mut u64, theirs: u64| *ours += theirs;
        each(&mut self.sent, other.sent);
        each(&mut self.warm_up, other.warm_up);
        each(&mut self.lost, other.lost);
        each(&mut self.received, other.received);
        each(&mut self.overtaken, other.overtaken);
        each(&mut self.refused, other.refused);
        each(&mut self.answered, other.answered);
        each(&mut self.repeated, other.repeated);
        each(&mut self.out_of_order, other.out_of_order);
        each(&mut self.incomplete, other.incomplete);
        self.read.iter_mut().zip(other.read).for_each(|(ours, theirs)| *ours += theirs);
        self.missed.iter_mut().zip(other.missed).for_each(|(ours, theirs)| *ours += theirs);
        self.sums_match &= other.sums_match;
        self
    }
}

/// The durations of one stage.
#[derive(Clone, Debug, Serialize)]
pub struct StageFigures {
    /// The stage that ended.
    pub stage: &'static str,
    /// Percentiles in microseconds, medians over the runs.
    #[serde(flatten)]
    pub took: Percentiles,
}

/// The measurement of one load.
#[derive(Clone, Debug, Serialize)]
pub struct LoadReport {
    /// The load's name.
    pub load: &'static str,
    /// From when latencies count.
    pub measured_from: &'static str,
    /// Latency until a reader has percept and completion in hand, microseconds: medians over the runs.
    pub latency_us: Percentiles,
    /// The same from when the observation was written.
    pub from_write_us: Percentiles,
    /// Of depth images: from when a frame was due until the last of its grids was written, microseconds: medians over the runs.
    pub frame_to_grids_us: Option<Percentiles>,
    /// `latency_us` of each run.
    pub runs: Vec<Percentiles>,
    /// The duration of each stage, microseconds.
    pub stages_us: Vec<StageFigures>,
    /// The observation of median latency: microseconds from when it was due to the end of each stage.
    pub median_observation_us: Map<String, Value>,
    /// Where every observation went.
    pub counts: Counts,
    /// All latencies of all runs, nanoseconds.
    #[serde(skip)]
    pub all: Histogram<u64>,
}

impl LoadReport {
    /// Of one or more runs.
    pub fn new(load: Load, runs: &[Run]) -> Self {
        let timed: Vec<Vec<&Record>> =
            runs.iter().map(|run| run.readers.iter().flatten().filter(|r| r.counted && r.is_complete()).collect()).collect();
        let percentiles = |of: &dyn Fn(&Record) -> u64| -> Vec<Percentiles> {
            timed.iter().map(|records| Percentiles::of_times(records.iter().map(|record| of(record)))).collect()
        };
        let latencies = percentiles(&Record::latency_ns);
        let stage = |stage: usize| StageFigures {
            stage: STAGES[stage + 1],
            took: Percentiles::median(&percentiles(&|record| record.stages_ns()[stage])),
        };
        Self {
            load: load.name(),
            measured_from: load.measured_from(),
            latency_us: Percentiles::median(&latencies),
            from_write_us: Percentiles::median(&percentiles(&Record::latency_from_write_ns)),
            frame_to_grids_us: (load == Load::Camera)
                .then(|| Percentiles::median(&timed.iter().map(|records| frames(records)).collect::<Vec<_>>())),
            stages_us: (0..STAGES.len() - 1).map(stage).collect(),
            median_observation_us: median_observation(timed.iter().flatten().copied()),
            counts: runs.iter().map(Counts::of).reduce(Counts::add).unwrap_or_default(),
            all: histogram(timed.iter().flatten().map(|record| record.latency_ns())),
            runs: latencies,
        }
    }

    /// Median time of each stage, microseconds.
    pub fn medians(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.stages_us.iter().map(|stage| (stage.stage, stage.took.p50))
    }
}

/// Time until the last grid of each frame was written. What is due at one time is one frame.
fn frames(records: &[&Record]) -> Percentiles {
    let mut last: BTreeMap<u64, u64> = BTreeMap::new();
    for record in records {
        let until = last.entry(record.stamps_ns[0]).or_default();
        *until = record.until_write_ns().max(*until);
    }
    Percentiles::of_times(last.into_values())
}

fn median_observation<'a>(records: impl Iterator<Item = &'a Record>) -> Map<String, Value> {
    let mut records: Vec<&Record> = records.collect();
    records.sort_by_key(|record| record.latency_ns());
    let Some(record) = records.get(records.len().saturating_sub(1) / 2) else { return Map::new() };
    let since_due = |stamp: u64| json!(stamp.saturating_sub(record.stamps_ns[0]) as f64 / 1e3);
    STAGES.iter().zip(record.stamps_ns).map(|(stage, stamp)| (stage.to_string(), since_due(stamp))).collect()
}

/// The measurement, its machine, and how far to trust it.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Which benchmark.
    pub benchmark: &'static str,
    /// On which machine, and how far to trust it.
    #[serde(flatten)]
    pub circumstances: Circumstances,
    /// With what.
    pub settings: Settings,
    /// The model's classes.
    pub classes: usize,
    /// The model's grid.
    pub dims: String,
    /// Which process ran where.
    pub cores: Cores,
    /// Which shared a core.
    pub shared: Vec<String>,
    /// The stages' names, in order.
    pub stages: [&'static str; STAGES.len()],
    /// The measurement of each load.
    pub loads: Vec<LoadReport>,
}

impl Report {
    /// Puts everything together.
    pub(super) fn new(settings: &Settings, mut circumstances: Circumstances, cores: Cores, model: &Model, loads: Vec<LoadReport>) -> Self {
        let warnings = &mut circumstances.warnings;
        if settings.wake == Wake::Polling && !cores.shared().is_empty() {
            warnings.push("polling needs a core for each process; here they share, and take time from each other".into());
        }
        for load in loads.iter().filter(|load| !load.counts.sums_match) {
            warnings.push(format!("{}: the counts of producer, daemon and readers contradict each other", load.load));
        }
        Self {
            benchmark: "latency",
            circumstances,
            settings: settings.clone(),
            classes: model.classes.len(),
            dims: model.dims().to_string(),
            shared: cores.shared(),
            cores,
            stages: STAGES,
            loads,
        }
    }

    /// The spread of the runs' medians: the largest ratio between two runs of one load.
    pub fn spread(&self) -> f64 {
        let of = |load: &LoadReport| {
            let medians = || load.runs.iter().map(|run| run.p50);
            medians().fold(0.0, f64::max) / medians().fold(f64::INFINITY, f64::min)
        };
        self.loads.iter().map(of).filter(|ratio| ratio.is_finite()).fold(1.0, f64::max)
    }

    /// Whether a load has too few answers for its last percentile to differ from the maximum.
    pub fn is_short(&self) -> bool {
        self.loads.iter().any(|load| median(load.runs.iter().map(|run| run.count as f64)) < 10_000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(sequence: u64, counted: bool, latency: u64) -> Record {
        let step = latency / 9;
        Record { sequence, counted, status: 0, stamps_ns: std::array::from_fn(|stage| 1000 + stage as u64 * step) }
    }

    fn run() -> Run {
        // 10 sent, 1 lost, 2 overtaken, 1 refused, 6 answered; the second reader missed one.
        let sent = Sent { sent: 10, warm_up: 2, received: 9, answered: 6, overtaken: 2, refused: 1 };
        let mut first: Vec<Record> = (1..=6).map(|n| record(n, n > 2, n * 9000)).collect();
        first.push(Record { status: 3, ..record(7, true, 9) });
        Run { sent, readers: vec![first.clone(), first[..6].to_vec()] }
    }

    #[test]
    fn every_observation_is_accounted_for() {
        let counts = Counts::of(&run());
        assert_eq!((counts.lost, counts.overtaken, counts.refused, counts.answered), (1, 2, 1, 6));
        assert_eq!((&counts.read[..], &counts.missed[..]), (&[7, 6][..], &[0, 1][..]));
        assert!(counts.sums_match && counts.repeated == 0 && counts.out_of_order == 0 && counts.incomplete == 0);
        let twice = counts.clone().add(counts);
        assert_eq!((twice.sent, &twice.read[..], twice.sums_match), (20, &[14, 12][..], true));

        let mut more_read_than_answered = run();
        more_read_than_answered.sent.answered = 5;
        assert!(!Counts::of(&more_read_than_answered).sums_match);
        let mut odd = run();
        odd.readers[0][1].sequence = 1;
        odd.readers[0][2].stamps_ns[5] = 1;
        odd.readers[0][3].stamps_ns[7] = 0;
        let counts = Counts::of(&odd);
        assert_eq!((counts.repeated, counts.out_of_order, counts.incomplete), (1, 1, 1));
    }

    #[test]
    fn times_are_of_what_was_answered_after_the_warm_up() {
        let report = LoadReport::new(Load::Steady, &[run(), run(), run()]);
        // Latencies 27, 36, 45, 54 µs, read by two readers, three runs.
        assert_eq!(report.latency_us.count, 24);
        assert!((report.latency_us.p50 - 36.0).abs() < 0.1 && (report.latency_us.max - 54.0).abs() < 0.1, "{:?}", report.latency_us);
        assert!((report.from_write_us.max - 42.0).abs() < 0.1);
        assert_eq!((report.stages_us.len(), report.frame_to_grids_us), (9, None));
        assert!(report.medians().all(|(_, us)| (us - 4.0).abs() < 0.01));
        assert_eq!((report.median_observation_us["due"].as_f64(), report.median_observation_us["read"].as_f64()), (Some(0.0), Some(36.0)));
        let none = LoadReport::new(Load::FlatOut, &[Run { sent: Sent::default(), readers: vec![] }]);
        assert!(none.latency_us.count == 0 && none.median_observation_us.is_empty() && none.counts.sums_match);
    }
}
