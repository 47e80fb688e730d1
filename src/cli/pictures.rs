//! Pictures and geometry that `watch` and `perceive` leave in folders: a picture of each object, and its query and completion as PLY.

use super::answers::{class_name, classes, hypotheses, posed};
use super::failure::{Failure, cannot_write};
use super::wording::describe_pose;
use crate::export::{GridPlacement, ply_of_points, ply_of_surface, points_of, save, surface_of};
use beo_core::grid::{Dims, Observation, Rotation, from_xyzw};
use beo_core::perception;
use beo_ipc::text::from_field;
use beo_ipc::{Completion, CompletionFrame, Percept, Status};
use beo_picture::Perceived;
use clap::Args;
use nalgebra::Vector3;
use std::path::PathBuf;

/// Where pictures and meshes go.
#[derive(Args, Clone, Debug)]
pub struct PictureArguments {
    /// Draw query, completion, its uncertainty, class and pose of each object into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Write each object into this folder for RViz, MeshLab or Blender: N-NAME-query.ply (points seen) and N-NAME-completion.ply (mesh;
    /// `quality` is the standard deviation), in metres in the observation's frame, in voxels where the scale is not known
    #[arg(long, value_name = "DIR")]
    ply: Option<PathBuf>,
}

impl PictureArguments {
    /// Makes the folders.
    pub fn prepare(&self) -> Result<(), Failure> {
        [&self.png, &self.ply].into_iter().flatten().try_for_each(|folder| std::fs::create_dir_all(folder).map_err(cannot_write(folder)))
    }

    /// Whether there is anything to be made.
    pub fn is_wanted(&self) -> bool {
        self.png.is_some() || self.ply.is_some()
    }
}

/// One object as it was perceived.
pub struct Shown {
    /// The beginning of its files' names.
    stem: String,
    title: String,
    observation: Observation,
    occupancy: Vec<f32>,
    deviation: Vec<f32>,
    classes: Vec<(String, f64)>,
    /// Hypotheses, where the pose was searched.
    poses: Vec<(Rotation, f64)>,
    pose: Option<Rotation>,
    placement: GridPlacement,
    /// Where the origin of the frame is that the grid lies in, in voxels from the grid's centre along its axes, and the frame's name.
    origin: Option<([f64; 3], String)>,
    /// Centre and lengths of the object's box in voxels, as in the picture.
    object_box: Option<([f64; 3], [f64; 3])>,
    notes: Vec<String>,
}

/// A name that is safe in a file's.
fn safe(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '_' }).collect()
}

fn shares(bytes: &[u8]) -> Vec<f32> {
    bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect()
}

fn as_lengths(lengths: [f32; 3]) -> String {
    lengths.map(|length| format!("{length:.3}")).join(" × ")
}

impl Shown {
    /// The answer of a daemon, the `number`th.
    pub fn of_answer(number: u64, percept: &Percept, completion: &Completion, status: &Status) -> Result<Self, Failure> {
        let header = completion.header();
        let [x, y, z] = header.dims.map(|side| side as usize);
        let dims = Dims::new(x, y, z)?;
        let name = class_name(status, percept.class_index);
        let p = percept.posterior.get(percept.class_index as usize).copied().unwrap_or(0.0);
        let searched = percept.rotation_spread_rad > 0.0;
        let completed = from_xyzw(header.rotation_object_to_grid.map(f64::from));
        let grid = GridPlacement {
            position_m: header.position_m,
            orientation: from_xyzw(header.orientation),
            voxel_size_m: f64::from(header.voxel_size_m),
        };
        // What was asked for in the object's frame is drawn there: its axes are those of the payload.
        let in_object_frame = header.frame == CompletionFrame::Object.code();
        let (placement, to_payload) =
            if in_object_frame { (grid.turned_by(&completed), completed.inverse()) } else { (grid, Rotation::identity()) };
        let extent_m = percept.object_extent_m.map(f64::from);
        let object_box = extent_m.iter().all(|side| *side > 0.0).then(|| {
            let from_centre = Vector3::from(percept.object_position_m) - Vector3::from(grid.position_m);
            let centre = placement.orientation.inverse() * from_centre / grid.voxel_size_m;
            (centre.into(), extent_m.map(|side| side / grid.voxel_size_m))
        });
        let is_placed = header.position_m != [0.0; 3];
        let origin = is_placed.then(|| {
            let name = match from_field(&header.frame_id) {
                "" => "sensor",
                name => name,
            };
            let from_centre = -Vector3::from(placement.position_m) / placement.voxel_size_m;
            ((placement.orientation.inverse() * from_centre).into(), name.to_owned())
        });
        let mut notes = Vec::new();
        if searched {
            notes.push(describe_pose(&completed, f64::from(percept.rotation_spread_rad)));
        }
        if is_placed {
            let [x, y, z] = percept.object_position_m;
            notes.push(format!("at ({x:.3}, {y:.3}, {z:.3}) m"));
        }
        if object_box.is_some() {
            notes.push(format!("{} m", as_lengths(percept.object_extent_m)));
            notes.push(format!("± {} m", as_lengths(percept.object_extent_deviation_m)));
        }
        if header.voxel_size_m != 1.0 {
            notes.push(format!("voxels of {:.1} mm", 1e3 * header.voxel_size_m));
        }
        Ok(Self {
            stem: format!("{number:04}-{}", safe(name)),
            title: format!("#{} {name} {:.1} %", percept.sequence, 100.0 * p),
            observation: Observation::of_completion(dims, completion.occupancy(), completion.deviation()),
            occupancy: shares(completion.occupancy()),
            deviation: shares(completion.deviation()),
            classes: (0..classes(percept)).map(|s| (class_name(status, s as u32).to_owned(), f64::from(percept.posterior[s]))).collect(),
            poses: if searched {
                hypotheses(percept).iter().map(posed).map(|(rotation, p)| (to_payload * rotation, p)).collect()
            } else {
                Vec::new()
            },
            pose: Some(to_payload * completed),
            placement,
            origin,
            object_box,
            notes,
        })
    }

    /// The answer to a file, the `number`th, of which nothing is said but its voxels and where the camera was, if there was one, in voxels
    /// from the grid's centre.
    pub fn of_file(
        number: usize,
        name: &str,
        names: &[&str],
        observation: &Observation,
        camera: Option<Vector3<f64>>,
        percept: &perception::Percept,
    ) -> Self {
        let class = names.get(percept.class).copied().unwrap_or("?");
        let p = percept.posterior.get(percept.class).copied().unwrap_or(0.0);
        let searched = percept.rotation_spread_rad > 0.0;
        Self {
            stem: format!("{number:04}-{}", safe(name)),
            title: format!("{name}: {class} {:.1} %", 100.0 * p),
            observation: observation.clone(),
            occupancy: percept.occupancy.clone(),
            deviation: percept.deviation.clone(),
            classes: names.iter().map(|name| (*name).to_owned()).zip(percept.posterior.iter().copied()).collect(),
            poses: if searched { percept.hypotheses.iter().map(|h| (h.rotation, h.probability)).collect() } else { Vec::new() },
            pose: Some(percept.rotation_object_to_grid),
            placement: GridPlacement::default(),
            origin: camera.map(|camera| (camera.into(), "camera".into())),
            object_box: percept.object_box.map(|found| (percept.placed.translation_voxels.into(), found.extent_voxels)),
            notes: if searched { vec![describe_pose(&percept.rotation_object_to_grid, percept.rotation_spread_rad)] } else { Vec::new() },
        }
    }

    /// Writes what is wanted of it.
    pub fn save(&self, wanted: &PictureArguments) -> Result<(), Failure> {
        if let Some(folder) = &wanted.png {
            let perceived = Perceived {
                title: self.title.clone(),
                observation: &self.observation,
                occupancy: &self.occupancy,
                deviation: &self.deviation,
                classes: self.classes.clone(),
                poses: self.poses.clone(),
                pose: self.pose,
                origin: self.origin.clone(),
                object_box: self.object_box,
                notes: self.notes.clone(),
            };
            perceived.draw().save(&folder.join(format!("{}.png", self.stem)))?;
        }
        if let Some(folder) = &wanted.ply {
            let points = points_of(&self.observation, &self.placement);
            let surface = surface_of(self.observation.dims(), &self.occupancy, &self.deviation, &self.placement);
            save(&folder.join(format!("{}-query.ply", self.stem)), &ply_of_points(&points, &self.title))?;
            save(&folder.join(format!("{}-completion.ply", self.stem)), &ply_of_surface(&surface, &self.title))?;
        }
        Ok(())
    }
}
