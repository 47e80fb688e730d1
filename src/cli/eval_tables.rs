//! `beo eval --view table`: shapes at rest on a table, seen by depth sensors with their faults.

use super::failure::{Failure, cannot_write};
use super::progress;
use super::shapes;
use super::train::{SensorsArgument, UnitsArgument, finer};
use beo_core::perception::Perceiver;
use beo_core::whole_file::write_whole;
use beo_lab::evaluation::{Resting, TableProtocol, on_tables};
use beo_shapes::ReadOptions;
use beo_shapes::library::LoadOptions;
use clap::{Args, ValueEnum};
use std::path::Path;

/// What is said of shapes on tables alone.
#[derive(Args, Clone, Debug)]
pub struct TableArguments {
    /// With --view table, the depth sensors, with what they and masks get wrong [default: mixed]
    #[arg(long, value_enum, value_name = "SENSORS")]
    sensors: Option<SensorsArgument>,
    /// With --view table, in which poses objects rest [default: upright]
    #[arg(long, value_enum, value_name = "POSES")]
    resting: Option<RestingArgument>,
    /// With --view table, the unit of length of the files [default: what DIR/units.txt says, or none]
    #[arg(long, value_enum, value_name = "UNIT")]
    units: Option<UnitsArgument>,
}

/// In which poses objects rest.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum RestingArgument {
    /// As they stand canonically
    Upright,
    /// On their sides: in stable poses of their convex hulls
    Lying,
}

impl TableArguments {
    /// The first of these arguments that is given: of other views they say nothing.
    pub fn given(&self) -> Option<&'static str> {
        let given = [("--sensors", self.sensors.is_some()), ("--resting", self.resting.is_some()), ("--units", self.units.is_some())];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag)
    }
}

/// The requested evaluation.
pub struct TableEvaluation<'a> {
    /// Folder of shapes.
    pub dir: &'a Path,
    /// Split to answer.
    pub split: Option<&'a String>,
    /// The model.
    pub perceiver: &'a Perceiver,
    /// How the shapes become voxels.
    pub read: ReadOptions,
    /// Lowest and highest elevation, radians.
    pub elevations_rad: [f64; 2],
    /// Views of each shape.
    pub views: usize,
    /// Seed of poses and views.
    pub seed: u64,
    /// Where the outcome goes as JSON.
    pub json: Option<&'a Path>,
    /// What is said of tables.
    pub tables: &'a TableArguments,
}

impl TableEvaluation<'_> {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let units = UnitsArgument::units(self.tables.units, self.dir)?;
        let read = ReadOptions { finer: finer(self.perceiver.model().dims()), ..self.read };
        let splits = self.split.map(std::slice::from_ref).unwrap_or_default();
        let shapes = shapes::load(self.dir, splits, &LoadOptions { read, skip_duplicates: false, minimum: 0, units })?;
        let classes = shapes::classes_in(&shapes.set.classes, self.perceiver.model())?;
        let protocol = TableProtocol {
            resting: match self.tables.resting {
                None | Some(RestingArgument::Upright) => Resting::Upright,
                Some(RestingArgument::Lying) => Resting::Lying,
            },
            sensing: self.tables.sensors.unwrap_or(SensorsArgument::Mixed).sensing(),
            elevations_rad: self.elevations_rad,
            views: self.views,
            seed: self.seed,
        };
        let bar = progress::bar(shapes.set.shapes.len() * self.views, "answering");
        let figures = on_tables(self.perceiver, &shapes.set, &classes, &protocol, || bar.inc(1));
        bar.finish_and_clear();
        let figures = figures?;
        say!("{}", figures.table().trim_end());
        if let Some(path) = self.json {
            let text = serde_json::to_string_pretty(&figures)?;
            write_whole(path, (text + "\n").as_bytes()).map_err(cannot_write(path))?;
        }
        Ok(())
    }
}
