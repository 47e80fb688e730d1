//! `beo eval`: the paper's protocol.

use super::arguments::{PoseArgument, PriorArgument, ProjectionArgument};
use super::eval_tables::{TableArguments, TableEvaluation};
use super::failure::{Failure, cannot_write};
use super::leave_one_out::LeaveOneOut;
use super::progress;
use super::shapes::{self, CAMERA_DISTANCE, ShapeArguments};
use beo_core::learning::Shape;
use beo_core::perception::{Method, PaperPose, Perceiver, PoseSearch, Query};
use beo_core::whole_file::write_whole;
use beo_lab::evaluation::figures::{self, Example};
use beo_lab::evaluation::{Evaluation, OneView, Protocol, Viewpoint, evaluate, evaluate_icp, sample, table};
use beo_shapes::Units;
use beo_shapes::library::LoadOptions;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Measure a model by the paper's protocol: one view of every object, in known or unknown pose
#[derive(Args)]
pub struct Eval {
    /// Folder of shapes, DIR/<class>/<split>/*, or DIR/* for one class named after the folder
    dir: PathBuf,
    /// Model file
    #[arg(long, required_unless_present = "leave_one_out")]
    model: Option<PathBuf>,
    /// Instead of answering by a model file: complete each shape by a model learned from all others, its class and pose known, seen from
    /// --view top or side, and compare with the nearest of the others and with their mean (section IV-D of the paper)
    #[arg(long, conflicts_with_all = NOT_FOR_LEAVE_ONE_OUT)]
    leave_one_out: bool,
    /// With --leave-one-out, voxels along each side of the grid [default: 30]; several, separated by commas: all shapes at each
    #[arg(long, value_delimiter = ',', value_name = "N")]
    resolution: Vec<usize>,
    /// Split to answer; never one that the model was trained on. Not for DIR/*, which has none. With --leave-one-out, the split to take shapes
    /// from [default: all]
    #[arg(long)]
    split: Option<String>,
    /// The prior knowledge of the pose
    #[arg(long, value_enum, default_value_t = PoseArgument::Known)]
    pose: PoseArgument,
    /// With --pose yaw, draw and search angles in [0, DEGREES); the paper's is 180
    #[arg(long, default_value_t = 360.0, value_name = "DEGREES")]
    yaw_span: f64,
    /// Tell the class, so that only the pose is to be found
    #[arg(long)]
    known_class: bool,
    /// Align the queries with the mean of their class by ICP too, from one start and from 24: the paper's baseline for pose
    #[arg(long)]
    icp: bool,
    /// Methods, separated by commas: auto, hull, evidence, paper, mean
    #[arg(long, value_delimiter = ',', default_value = "auto")]
    method: Vec<Method>,
    /// How the paper's method projects
    #[arg(long, value_enum, default_value_t = ProjectionArgument::Lasso)]
    projection: ProjectionArgument,
    /// How the paper's method finds the pose
    #[arg(long, value_enum, default_value_t = PaperPoseArgument::Edt)]
    paper_pose: PaperPoseArgument,
    /// Prior over the classes
    #[arg(long, value_enum, default_value_t = PriorArgument::Uniform)]
    prior: PriorArgument,
    /// View of the objects
    #[arg(long, value_enum, default_value_t = SeenFrom::Top)]
    view: SeenFrom,
    /// With --view camera, its heights above the horizontal, separated by commas: all queries for each
    #[arg(long, value_delimiter = ',', default_values_t = [30.0], value_name = "DEGREES")]
    elevation: Vec<f64>,
    /// With --view camera, from so many directions around each object, one query each
    #[arg(long, default_value_t = 8, value_name = "N")]
    azimuths: usize,
    /// With --view camera, its distance in longest sides of the object
    #[arg(long, default_value_t = CAMERA_DISTANCE, value_name = "TIMES")]
    distance: f64,
    /// With --view camera, fuse so many views from around the object before asking; several numbers, separated by commas: all queries for each
    #[arg(long, value_delimiter = ',', default_values_t = [1], value_name = "VIEWS")]
    fuse: Vec<usize>,
    /// With --view camera, lay the grid about what is visible, and have size and place found
    #[arg(long)]
    find_size: bool,
    /// Answer a sample of this many, classes in proportion
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Seed of the sample and of the rotations
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Write the outcome as JSON: one object, or a list when several methods are given; with --icp, the object has `icp` too, or {methods, icp}
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Draw completion error, pose error, query time, accuracy, reliability and some completions into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    #[command(flatten)]
    tables: TableArguments,
    #[command(flatten)]
    shaping: ShapeArguments,
}

/// Arguments that say nothing when shapes are left out: pose and class are known, and there is one method.
const NOT_FOR_LEAVE_ONE_OUT: [&str; 17] = [
    "model",
    "pose",
    "yaw_span",
    "known_class",
    "icp",
    "method",
    "projection",
    "paper_pose",
    "prior",
    "elevation",
    "azimuths",
    "distance",
    "fuse",
    "find_size",
    "sensors",
    "resting",
    "units",
];

/// From where objects are seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SeenFrom {
    /// Straight from above
    Top,
    /// With --leave-one-out: along the x axis, +x hidden
    Side,
    /// By a camera
    Camera,
    /// At rest on a table, by depth sensors with their faults, everything unknown: --elevation gives the lowest and the highest, --azimuths the
    /// views of each
    Table,
}

/// How the paper's method finds the pose.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum PaperPoseArgument {
    /// Coarse by distance transforms (eq. 20), fine by density (eq. 21); with a known class by its density (eq. 12)
    Edt,
    /// Density alone (eqs. 12, 21)
    Density,
    /// Distance to the back-projection (eq. 11)
    Distance,
    /// The same relative to the query's length (eq. 19)
    Reprojection,
}

impl PaperPoseArgument {
    fn estimator(self) -> PaperPose {
        match self {
            Self::Edt => PaperPose::Edt,
            Self::Density => PaperPose::Density,
            Self::Distance => PaperPose::Distance,
            Self::Reprojection => PaperPose::Reprojection,
        }
    }
}

impl Eval {
    /// From where objects are seen.
    fn viewpoints(&self) -> Result<Vec<Viewpoint>, Failure> {
        let usage = |line: String| Err(Failure::Usage(line));
        match self.view {
            SeenFrom::Side => return usage("--view side: only with --leave-one-out; use --view top or --view camera".into()),
            SeenFrom::Top => return Ok(vec![Viewpoint::Top]),
            SeenFrom::Camera | SeenFrom::Table => (),
        }
        if self.elevation.is_empty() || !self.elevation.iter().all(|e| (-90.0..=90.0).contains(e)) {
            return usage("--elevation: use angles from -90 to 90 degrees".into());
        }
        if !(1..=360).contains(&self.azimuths) || self.fuse.is_empty() || !self.fuse.iter().all(|views| (1..=64).contains(views)) {
            return usage("--azimuths, --fuse: use 1 to 360 directions, and 1 to 64 views".into());
        }
        if !(1.0..=1000.0).contains(&self.distance) {
            return usage(format!("--distance {}: use 1 to 1000 times the object's longest side", self.distance));
        }
        if self.icp || self.pose as u8 == PoseArgument::Full as u8 && self.find_size {
            return usage("--view camera: --icp is for views from above, and --find-size for upright objects (--pose known or yaw)".into());
        }
        let viewpoint = |elevation_deg: &f64, fused: &usize| Viewpoint::Camera {
            elevation_deg: *elevation_deg,
            azimuths: self.azimuths,
            distance: self.distance,
            fused: *fused,
            scale_search: self.find_size,
        };
        Ok(self.elevation.iter().flat_map(|e| self.fuse.iter().map(move |f| viewpoint(e, f))).collect())
    }

    /// Whether what is asked of shapes on tables can be answered, and nothing about tables is said of other views.
    fn check_tables(&self) -> Result<(), Failure> {
        let usage = |line: String| Err(Failure::Usage(line));
        if self.view != SeenFrom::Table {
            return match self.tables.given() {
                Some(flag) => usage(format!("{flag}: only with --view table")),
                None => Ok(()),
            };
        }
        let changed = [
            ("--pose", !matches!(self.pose, PoseArgument::Known)),
            ("--yaw-span", self.yaw_span != 360.0),
            ("--known-class", self.known_class),
            ("--icp", self.icp),
            ("--method", self.method != [Method::Auto]),
            ("--projection", !matches!(self.projection, ProjectionArgument::Lasso)),
            ("--paper-pose", !matches!(self.paper_pose, PaperPoseArgument::Edt)),
            ("--prior", !matches!(self.prior, PriorArgument::Uniform)),
            ("--distance", self.distance != CAMERA_DISTANCE),
            ("--fuse", self.fuse != [1]),
            ("--find-size", self.find_size),
            ("--limit", self.limit.is_some()),
            ("--png", self.png.is_some()),
        ];
        match changed.into_iter().find(|(_, is_changed)| *is_changed) {
            Some((flag, _)) => usage(format!("{flag}: with --view table everything is unknown and asked once; leave it out")),
            None => Ok(()),
        }
    }

    fn leave_one_out(&self) -> Result<(), Failure> {
        let view = match self.view {
            SeenFrom::Top => OneView::Top,
            SeenFrom::Side => OneView::Side,
            SeenFrom::Camera | SeenFrom::Table => {
                return Err(Failure::Usage("--leave-one-out: use --view top or --view side".into()));
            }
        };
        LeaveOneOut {
            dir: &self.dir,
            splits: self.split.iter().cloned().collect(),
            resolutions: if self.resolution.is_empty() { &[30] } else { &self.resolution },
            view,
            limit: self.limit,
            seed: self.seed,
            json: self.json.as_ref(),
            png: self.png.as_ref(),
            shaping: &self.shaping,
        }
        .run()
    }

    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let Some(model) = self.model.as_ref().filter(|_| !self.leave_one_out) else { return self.leave_one_out() };
        if !self.resolution.is_empty() {
            return Err(Failure::Usage("--resolution: a model has its own; only with --leave-one-out".into()));
        }
        let viewpoints = self.viewpoints()?;
        self.check_tables()?;
        let pose = self.pose.search(self.yaw_span)?;
        if self.icp && pose == PoseSearch::Known {
            return Err(Failure::Usage("--icp: in known pose there is nothing to align; give --pose yaw or --pose full".into()));
        }
        if self.limit == Some(0) {
            return Err(Failure::Usage("--limit 0: nothing to answer; use at least 1".into()));
        }
        if self.split.is_none() {
            shapes::require_flat(&self.dir)?;
        }
        if let Some(folder) = &self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let perceiver = Perceiver::open(model)?;
        let model = perceiver.model().clone();
        if let Some(split) = self.split.as_ref().filter(|split| model.metadata.settings.splits.contains(split)) {
            warn!("warning: the model was trained on split `{split}`: these figures say nothing about new objects");
        }
        let read = self.shaping.read_options(model.dims())?;
        if self.view == SeenFrom::Table {
            let elevations = || self.elevation.iter().map(|degrees| degrees.to_radians());
            let evaluation = TableEvaluation {
                dir: &self.dir,
                split: self.split.as_ref(),
                perceiver: &perceiver,
                read,
                elevations_rad: [elevations().fold(f64::INFINITY, f64::min), elevations().fold(f64::NEG_INFINITY, f64::max)],
                views: self.azimuths,
                seed: self.seed,
                json: self.json.as_deref(),
                tables: &self.tables,
            };
            return evaluation.run();
        }
        let shapes =
            shapes::load(&self.dir, self.split.as_slice(), &LoadOptions { read, skip_duplicates: false, minimum: 0, units: Units::None })?;
        let names: Vec<&str> = model.class_names().collect();
        let classes = shapes::classes_in(&shapes.set.classes, &model)?;
        let chosen = sample(&shapes.set, self.limit, self.seed);
        let protocols: Vec<Protocol> =
            viewpoints.iter().map(|viewpoint| Protocol { viewpoint: *viewpoint, seed: self.seed, known_class: self.known_class }).collect();
        // The same queries for each viewpoint: every object as often as it is seen.
        let chosen: Vec<&Shape> = chosen.into_iter().flat_map(|shape| std::iter::repeat_n(shape, viewpoints[0].azimuths())).collect();
        let mut evaluations: Vec<Evaluation> = Vec::new();
        // Only the queries that are drawn are kept, as the first method answers them.
        let drawn = if self.png.is_some() { figures::spread(chosen.len(), figures::EXAMPLES) } else { Vec::new() };
        let mut examples: Vec<Example> = Vec::new();
        for (m, (method, protocol)) in self.method.iter().flat_map(|m| protocols.iter().map(move |p| (m, p))).enumerate() {
            let query = Query {
                method: *method,
                pose,
                log_prior: self.prior.log_prior(&perceiver),
                projection: self.projection.projection(),
                paper_pose: self.paper_pose.estimator(),
                ..Query::default()
            };
            let bar = progress::bar(chosen.len(), "answering");
            let mut answered = 0;
            let evaluation = evaluate(&perceiver, &chosen, &classes, &query, protocol, |object, truth, observation, percept| {
                if m == 0 && drawn.contains(&answered) {
                    examples.push(Example::new(&names, truth, object, observation, percept));
                }
                answered += 1;
                bar.inc(1);
            });
            bar.finish_and_clear();
            evaluations.push(evaluation?);
        }
        let mut icp = Vec::new();
        if self.icp {
            let bar = progress::bar(2 * chosen.len(), "aligning by ICP");
            icp = evaluate_icp(&perceiver, &chosen, &classes, pose, &protocols[0], || bar.inc(1));
            bar.finish_and_clear();
        }
        say!("{}", table(&evaluations, &icp).trim_end());
        if let Some(path) = &self.json {
            let mut outcome = match evaluations.as_slice() {
                [one] => serde_json::to_value(one)?,
                several => serde_json::to_value(several)?,
            };
            if self.icp {
                match &mut outcome {
                    serde_json::Value::Object(one) => drop(one.insert("icp".into(), serde_json::to_value(&icp)?)),
                    several => *several = serde_json::json!({ "methods": several.take(), "icp": icp }),
                }
            }
            let text = serde_json::to_string_pretty(&outcome)?;
            write_whole(path, (text + "\n").as_bytes()).map_err(cannot_write(path))?;
        }
        if let Some(folder) = &self.png {
            figures::save(folder, &evaluations, &icp, &examples)?;
        }
        Ok(())
    }
}
