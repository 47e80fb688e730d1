//! NumPy answering the same queries in known pose, in a process of its own, and whether it answers the same.
//!
//! The peers are the Python files of `crates/lab/peers`, which the program carries along. They get the queries as one array, time each
//! answer themselves, and give times, posteriors and completions back.

use super::questions::Question;
use crate::benchmark::percentiles::Percentiles;
use beo_core::perception::{PerceiveError, Perceiver, Percept};
use beo_shapes::npy::{NpyHeader, write_npy_header};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The algorithms of peers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Peer {
    /// Evidence in the shared basis: another estimator, the plain way.
    SharedEvidence,
    /// Exactly our algorithm.
    SameAlgorithm,
}

/// Code that both share, and where it lies beside them.
const COMMON: (&str, &str) = ("peer.py", include_str!("../../../peers/peer.py"));
/// Exit code of a peer without NumPy.
const MISSING: i32 = 77;
/// No peer takes longer.
const PATIENCE: Duration = Duration::from_secs(900);

impl Peer {
    /// All.
    pub const ALL: [Self; 2] = [Self::SharedEvidence, Self::SameAlgorithm];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SharedEvidence => "NumPy, evidence in the shared basis",
            Self::SameAlgorithm => "NumPy, the same algorithm",
        }
    }

    fn script(self) -> (&'static str, &'static str) {
        match self {
            Self::SharedEvidence => ("shared_evidence.py", include_str!("../../../peers/shared_evidence.py")),
            Self::SameAlgorithm => ("same_algorithm.py", include_str!("../../../peers/same_algorithm.py")),
        }
    }
}

/// A peer could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// There is no Python with NumPy: the figures are made without it.
    #[error("{python} cannot run the NumPy peers: {why}; give --python, or set BEO_PYTHON, to one with numpy and safetensors")]
    Missing {
        /// The attempted operation.
        python: String,
        /// Its error.
        why: String,
    },
    /// Files cannot be exchanged with it.
    #[error("cannot exchange files with the peers in {}: {cause}", folder.display())]
    Files {
        /// Where.
        folder: PathBuf,
        /// The system's words.
        cause: std::io::Error,
    },
    /// It failed.
    #[error("the peer {script} ended with {status}; its own message stands above")]
    Failed {
        /// Its file.
        script: &'static str,
        /// How it ended.
        status: std::process::ExitStatus,
    },
    /// It takes for ever.
    #[error("the peer {script} has not ended within {} s", PATIENCE.as_secs())]
    Silent {
        /// Its file.
        script: &'static str,
    },
    /// Its output cannot be read.
    #[error("the peer {script} gave {what}")]
    Output {
        /// Its file.
        script: &'static str,
        /// The fault.
        what: String,
    },
    /// Our own answer failed.
    #[error(transparent)]
    Own(#[from] PerceiveError),
    /// Someone asked it to end.
    #[error("interrupted before all was measured")]
    Interrupted,
}

/// Largest differences between a peer's answers and ours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Queries that were compared.
    pub queries: usize,
    /// Of them, with the same class.
    pub same_class: usize,
    /// Posterior of any class.
    pub posterior: f64,
    /// Probability of any voxel.
    pub occupancy: f64,
    /// Deviation of any voxel; 0 if the peer gives none.
    pub deviation: f64,
}

impl Agreement {
    /// Whether it is the same answer, up to rounding.
    pub fn is_equal(&self) -> bool {
        self.same_class == self.queries && self.posterior <= 1e-3 && self.occupancy <= 2e-3 && self.deviation <= 2e-3
    }
}

/// One run of a peer over all queries.
pub struct PeerRun {
    /// Version of NumPy.
    pub numpy: String,
    /// Threads that it was given.
    pub threads: usize,
    /// Times of single queries.
    pub times: Percentiles,
    /// How its answers compare with ours.
    pub agreement: Agreement,
}

/// Our own answer to one question.
pub struct OwnAnswer {
    /// With completion.
    pub percept: Percept,
    /// The classes whose evidence was computed for the class, not only for the completion.
    pub scored: Vec<bool>,
}

/// Answers all questions.
pub fn own_answers(perceiver: &Perceiver, questions: &[Question]) -> Result<Vec<OwnAnswer>, PerceiveError> {
    let mut work = perceiver.workspace();
    let mut answer = |question: &Question| {
        let mut percept = Percept::default();
        let classified = perceiver.classify(&question.observation, &question.query, &mut work, &mut percept)?;
        let scored = classified.percept().log_evidence.iter().map(|evidence| *evidence != 0.0).collect();
        classified.complete()?;
        Ok(OwnAnswer { percept, scored })
    };
    questions.iter().map(&mut answer).collect()
}

/// The folder in which files are exchanged; removed when dropped.
pub struct Peers {
    folder: PathBuf,
    python: PathBuf,
    model: PathBuf,
}

#[derive(Deserialize)]
struct Answers {
    numpy: String,
    threads: usize,
    ns: Vec<u64>,
    posteriors: Vec<Vec<f64>>,
}

impl Peers {
    /// Writes queries (at least one, of the model's dims) and scripts into a new folder among the temporary ones.
    pub fn new(python: &Path, model: &Path, questions: &[Question]) -> Result<Self, PeerError> {
        let folder = std::env::temp_dir().join(format!("beo-bench-query-{}", std::process::id()));
        let files = |cause| PeerError::Files { folder: folder.clone(), cause };
        fs::create_dir_all(&folder).map_err(files)?;
        let peers = Self { folder: folder.clone(), python: python.into(), model: fs::canonicalize(model).map_err(files)? };
        for (name, text) in Peer::ALL.map(Peer::script).into_iter().chain([COMMON]) {
            fs::write(folder.join(name), text).map_err(files)?;
        }
        peers.write_queries(questions).map_err(files)?;
        Ok(peers)
    }

    fn write_queries(&self, questions: &[Question]) -> std::io::Result<()> {
        let Some(first) = questions.first() else { return Ok(()) };
        let dims = first.observation.dims();
        let shape: Vec<usize> = [questions.len()].into_iter().chain(<[usize; 3]>::from(dims)).collect();
        let mut file = BufWriter::new(File::create(self.folder.join("queries.npy"))?);
        write_npy_header::<u8>(&mut file, &shape)?;
        let mut codes = vec![0; dims.voxels()];
        for question in questions {
            question.observation.write(&mut codes);
            file.write_all(&codes)?;
        }
        file.flush()
    }

    /// Runs a peer with this many threads, and compares its answers with ours.
    pub fn run(&self, peer: Peer, threads: usize, own: &[OwnAnswer], stop: &AtomicBool) -> Result<PeerRun, PeerError> {
        let (script, _) = peer.script();
        let wrong = |what: String| PeerError::Output { script, what };
        let answers: Answers = serde_json::from_str(&self.ask(script, threads, stop)?).map_err(|error| wrong(error.to_string()))?;
        if answers.ns.len() != own.len() || answers.posteriors.len() != own.len() {
            return Err(wrong(format!("{} times and {} answers to {} queries", answers.ns.len(), answers.posteriors.len(), own.len())));
        }
        let occupancy = self.read("occupancy.npy").map_err(wrong)?;
        let deviation = match peer {
            Peer::SharedEvidence => Vec::new(),
            Peer::SameAlgorithm => self.read("deviation.npy").map_err(wrong)?,
        };
        let agreement = compare(own, &answers.posteriors, &occupancy, &deviation).map_err(wrong)?;
        Ok(PeerRun { numpy: answers.numpy, threads: answers.threads, times: Percentiles::of_times(answers.ns), agreement })
    }

    /// The output of a script.
    fn ask(&self, script: &'static str, threads: usize, stop: &AtomicBool) -> Result<String, PeerError> {
        let files = |cause| PeerError::Files { folder: self.folder.clone(), cause };
        let missing = |why: String| PeerError::Missing { python: self.python.display().to_string(), why };
        let (output, messages) = (self.folder.join("output"), self.folder.join("messages"));
        let mut child = Command::new(&self.python)
            .arg(self.folder.join(script))
            .args([&self.model, &self.folder.join("queries.npy"), &self.folder])
            .envs(["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"].map(|name| (name, threads.to_string())))
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::null())
            .stdout(File::create(&output).map_err(files)?)
            .stderr(File::create(&messages).map_err(files)?)
            .spawn()
            .map_err(|error| missing(error.to_string()))?;
        let start = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().map_err(files)? {
                break status;
            }
            let stopped = stop.load(Ordering::Relaxed);
            if stopped || start.elapsed() > PATIENCE {
                let _ = child.kill();
                let _ = child.wait();
                return Err(if stopped { PeerError::Interrupted } else { PeerError::Silent { script } });
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        let messages = fs::read_to_string(messages).map_err(files)?;
        if status.code() == Some(MISSING) {
            return Err(missing(messages.trim().to_owned()));
        }
        eprint!("{messages}");
        if !status.success() {
            return Err(PeerError::Failed { script, status });
        }
        fs::read_to_string(output).map_err(files)
    }

    fn read(&self, name: &str) -> Result<Vec<f32>, String> {
        let bytes = fs::read(self.folder.join(name)).map_err(|error| format!("no {name}: {error}"))?;
        let numbers = NpyHeader::parse(&bytes).and_then(|header| header.numbers(&bytes));
        numbers.map_err(|error| format!("a {name} that cannot be read: {error}"))
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// The largest differences. `deviation` may be empty.
fn compare(own: &[OwnAnswer], posteriors: &[Vec<f64>], occupancy: &[f32], deviation: &[f32]) -> Result<Agreement, String> {
    let mut agreement = Agreement { queries: own.len(), ..Agreement::default() };
    for (i, (OwnAnswer { percept, .. }, posterior)) in own.iter().zip(posteriors).enumerate() {
        if posterior.len() != percept.posterior.len() {
            return Err(format!("posteriors of {} classes, not {}", posterior.len(), percept.posterior.len()));
        }
        let class = (0..posterior.len()).max_by(|s, t| posterior[*s].total_cmp(&posterior[*t]));
        agreement.same_class += usize::from(class == Some(percept.class));
        agreement.posterior = largest(agreement.posterior, percept.posterior.iter().zip(posterior).map(|(a, b)| (a - b).abs()));
        let d = percept.occupancy.len();
        let voxels = |values: &[f32], ours: &[f32]| -> Result<f64, String> {
            let theirs = values.get(i * d..(i + 1) * d).ok_or_else(|| format!("{} voxels in all", values.len()))?;
            Ok(largest(0.0, ours.iter().zip(theirs).map(|(a, b)| f64::from((a - b).abs()))))
        };
        agreement.occupancy = agreement.occupancy.max(voxels(occupancy, &percept.occupancy)?);
        if !deviation.is_empty() {
            agreement.deviation = agreement.deviation.max(voxels(deviation, &percept.deviation)?);
        }
    }
    Ok(agreement)
}

/// The largest of some values; infinite if one is not a number.
fn largest(start: f64, values: impl Iterator<Item = f64>) -> f64 {
    values.fold(start, |most, value| if value.is_nan() { f64::INFINITY } else { most.max(value) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_anywhere_is_found() {
        let percept = |class: usize| Percept {
            class,
            posterior: (0..2).map(|s| if s == class { 0.75 } else { 0.25 }).collect(),
            occupancy: vec![0.5, 1.0],
            deviation: vec![0.25, 0.0],
            ..Percept::default()
        };
        let own = [0, 1].map(|class| OwnAnswer { percept: percept(class), scored: Vec::new() });
        let posteriors = [vec![0.75, 0.25], vec![0.25, 0.75]];
        let same = compare(&own, &posteriors, &[0.5, 1.0, 0.5, 1.0], &[0.25, 0.0, 0.25, 0.0]).unwrap();
        assert_eq!(same, Agreement { queries: 2, same_class: 2, ..Agreement::default() });
        assert!(same.is_equal());
        for (posterior, occupancy, deviation) in
            [(0.7, 1.0, 0.0), (0.75, 0.9, 0.0), (0.75, 1.0, 0.1), (f64::NAN, 1.0, 0.0), (0.2, 1.0, 0.0)]
        {
            let posteriors = [vec![0.75, 0.25], vec![0.25, posterior]];
            let other = compare(&own, &posteriors, &[0.5, 1.0, 0.5, occupancy], &[0.25, 0.0, 0.25, deviation]).unwrap();
            assert!(!other.is_equal(), "{other:?}");
        }
        assert!(compare(&own, &posteriors, &[0.5], &[]).is_err());
        assert!(compare(&own, &[vec![1.0], vec![1.0]], &[], &[]).is_err());
    }
}
