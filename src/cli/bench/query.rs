//! `beo bench query`.

use crate::cli::failure::Failure;
use crate::cli::shapes::{self, ShapeArguments};
use crate::cli::{progress, stop};
use beo_core::model::{Model, load};
use beo_core::perception::Perceiver;
use beo_lab::benchmark::limits::Limits;
use beo_lab::benchmark::machine::Watch;
use beo_lab::benchmark::percentiles::Percentiles;
use beo_lab::benchmark::query::{
    Condition, Evictor, Floor, Object, OwnAnswer, Peer, PeerError, PeerRow, Peers, Question, Report, Row, Search, Task, furniture,
    own_answers, questions, time_answers, time_icp,
};
use beo_lab::evaluation::sample;
use beo_shapes::Units;
use beo_shapes::library::LoadOptions;
use beo_shapes::read_shape;
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Time the compute of queries alone, beside peers and the machine's own limits
#[derive(Args)]
pub struct Query {
    /// Complete shapes to ask about, or one folder of them: DIR/<class>/<split>/* with --split, or DIR/* [default: made-up furniture]
    shapes: Vec<PathBuf>,
    /// The split of the folder
    #[arg(long)]
    split: Option<String>,
    /// Model file
    #[arg(long, default_value = "models/modelnet10.safetensors")]
    model: PathBuf,
    /// Different queries of each kind; the default run takes a minute or so, one that says something of p99 (--queries 1000) half an hour
    #[arg(long, default_value_t = 25, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    queries: u32,
    /// Rounds over everything; medians over them are reported
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Python with numpy and safetensors, for the peers [default: $BEO_PYTHON, else python3]
    #[arg(long, value_name = "PROGRAM")]
    python: Option<PathBuf>,
    /// Leave the peers out: NumPy and ICP
    #[arg(long)]
    alone: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    shaping: ShapeArguments,
}

/// Queries of one kind, and what every repeat measured of them.
struct Kind {
    search: Search,
    task: Task,
    condition: Condition,
    repeats: Vec<Percentiles>,
}

impl Query {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let stop = stop::on_signal()?;
        let watch = Watch::start();
        let model = Arc::new(load(&self.model)?);
        if !model.levels().is_empty() {
            let line = format!("{} is for grids of {}: `beo bench large` times those", self.model.display(), model.dims());
            return Err(Failure::Usage(line));
        }
        let (objects, about) = self.objects(&model)?;
        let perceiver = Perceiver::new(model.clone())?;
        let limits = Limits::measure(watch.machine());
        let evictor = Evictor::new(watch.machine());
        let searches = Search::of(&model);
        let asked = searches.iter().map(|search| questions(&perceiver, &objects, *search)).collect::<Result<Vec<_>, _>>()?;
        let own = asked.iter().map(|asked| own_answers(&perceiver, asked)).collect::<Result<Vec<_>, _>>()?;

        let mut kinds: Vec<Kind> = Vec::new();
        for search in searches.iter().copied() {
            for task in [Task::Class, Task::Completion] {
                kinds.extend(Condition::ALL.map(|condition| Kind { search, task, condition, repeats: Vec::new() }));
            }
        }
        let of = |search: Search| searches.iter().position(|s| *s == search).unwrap_or(0);
        let known = (&asked[of(Search::Known)], &own[of(Search::Known)]);
        let mut others = Others::new(&self, known.0)?;
        let mut work = perceiver.workspace();
        let bar = progress::bar(self.repeats as usize * (kinds.len() + 4), "answering");
        for _ in 0..self.repeats {
            for kind in &mut kinds {
                if stop.load(Ordering::Relaxed) {
                    return Err(PeerError::Interrupted.into());
                }
                let times = time_answers(&perceiver, &mut work, &asked[of(kind.search)], kind.task, kind.condition, &evictor)?;
                kind.repeats.push(times);
                bar.inc(1);
            }
            others.measure(&perceiver, &asked, known.1, limits.threads, &stop)?;
            bar.inc(4);
        }
        bar.finish_and_clear();

        let floor = |search: Search, task| {
            let answered = asked[of(search)].iter().zip(&own[of(search)]);
            let floors: Vec<Floor> = answered.map(|(question, answer)| Floor::new(&model, search, question, answer, task)).collect();
            Floor::mean(&floors)
        };
        let row = |kind: &Kind| {
            let Kind { search, task, condition, repeats } = kind;
            Row::new(*search, *task, *condition, repeats, floor(*search, *task), &limits)
        };
        let rows: Vec<Row> = kinds.iter().map(row).collect();
        let peers = others.rows(&rows, limits.threads);
        let (queries, repeats) = (objects.len(), self.repeats as usize);
        let report = Report {
            benchmark: "query",
            circumstances: watch.end(),
            limits,
            about,
            queries,
            repeats,
            rows,
            peers,
            skipped: others.skipped,
        };
        if self.json {
            say!("{}", serde_json::to_string(&report)?);
        } else {
            say!("{}", report.text().trim_end());
        }
        Ok(())
    }

    /// The questions and their description.
    fn objects(&self, model: &Model) -> Result<(Vec<Object>, String), Failure> {
        let (count, dims) = (self.queries as usize, model.dims());
        let names: Vec<&str> = model.class_names().collect();
        let read = self.shaping.read_options(dims)?;
        let class_of = |name: &str| names.iter().position(|known| *known == name);
        let model_text = format!("{}, {dims}, {} classes", self.model.display(), names.len());
        let (objects, what) = match (&self.shapes[..], &self.split) {
            ([], None) => (furniture(dims, count, &names), "made-up furniture".to_owned()),
            ([folder], split) if split.is_some() || folder.is_dir() => {
                if split.is_none() {
                    shapes::require_flat(folder)?;
                }
                let options = LoadOptions { read, skip_duplicates: false, minimum: 1, units: Units::None };
                let library = shapes::load(folder, split.as_slice(), &options)?;
                let chosen = sample(&library.set, Some(count), 0);
                let object = |shape: &&beo_core::learning::Shape| Object {
                    shape: shape.object.clone(),
                    class: class_of(&library.set.classes[shape.class]),
                };
                let split = split.as_ref().map_or(String::new(), |split| format!(", split {split}"));
                (chosen.iter().map(object).collect(), format!("{}{split}", folder.display()))
            }
            (_, Some(split)) => return Err(Failure::Usage(format!("--split {split}: give the one folder that it is a split of"))),
            (files, None) => {
                let object = |path: &PathBuf| Ok(Object { shape: read_shape(path, &read.for_file(path)?)?, class: None });
                (files.iter().take(count).map(object).collect::<Result<_, Failure>>()?, format!("{} files", files.len().min(count)))
            }
        };
        if objects.is_empty() {
            return Err(Failure::Failed(format!("{what}: no shape to ask about")));
        }
        Ok((objects, format!("{model_text}; {what}")))
    }
}

/// Others that answer the same queries.
struct Others {
    peers: Option<Peers>,
    numpy: Vec<(Peer, String, Vec<Percentiles>, beo_lab::benchmark::query::Agreement)>,
    icp: Vec<(Search, Vec<Percentiles>)>,
    alone: bool,
    skipped: Vec<String>,
}

impl Others {
    fn new(command: &Query, known: &[Question]) -> Result<Self, Failure> {
        let mut others = Self { peers: None, numpy: Vec::new(), icp: Vec::new(), alone: command.alone, skipped: Vec::new() };
        if command.alone {
            others.skipped.push("the peers, by --alone".into());
        } else {
            let python = command.python.clone().or_else(|| std::env::var_os("BEO_PYTHON").map(PathBuf::from)).unwrap_or("python3".into());
            others.peers = Some(Peers::new(&python, &command.model, known)?);
        }
        Ok(others)
    }

    /// One round of all of them. `known` answers the queries in known pose.
    fn measure(
        &mut self,
        perceiver: &Perceiver,
        asked: &[Vec<Question>],
        known: &[OwnAnswer],
        threads: usize,
        stop: &std::sync::atomic::AtomicBool,
    ) -> Result<(), Failure> {
        if self.alone {
            return Ok(());
        }
        for (search, asked) in Search::of(perceiver.model()).into_iter().zip(asked) {
            if let Some(times) = time_icp(perceiver, asked, search) {
                match self.icp.iter_mut().find(|(s, _)| *s == search) {
                    Some((_, repeats)) => repeats.push(times),
                    None => self.icp.push((search, vec![times])),
                }
            }
        }
        let Some(peers) = &self.peers else { return Ok(()) };
        for peer in Peer::ALL {
            match peers.run(peer, threads, known, stop) {
                Ok(run) => match self.numpy.iter_mut().find(|(p, ..)| *p == peer) {
                    Some((_, _, repeats, _)) => repeats.push(run.times),
                    None => self.numpy.push((peer, run.numpy, vec![run.times], run.agreement)),
                },
                Err(error @ PeerError::Missing { .. }) => {
                    self.skipped.push(error.to_string());
                    self.peers = None;
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    fn rows(&self, ours: &[Row], threads: usize) -> Vec<PeerRow> {
        let warm =
            |search: Search, task: Task| ours.iter().find(|r| r.search == search && r.task == task && r.condition == Condition::Warm);
        let numpy = self.numpy.iter().filter_map(|(peer, version, repeats, agreement)| {
            let name = format!("{} ({version})", peer.name());
            Some(PeerRow::new(&name, threads, repeats, warm(Search::Known, Task::Completion)?, Some(*agreement)))
        });
        let icp = self.icp.iter().filter_map(|(search, repeats)| {
            let name = format!("ICP from 24 starts, class told, {}", search.name());
            Some(PeerRow::new(&name, 1, repeats, warm(*search, Task::Class)?, None))
        });
        numpy.chain(icp).collect()
    }
}
