//! What is asked about a grid: one reading of the arguments, for a model in this process and for a daemon.

use crate::arrays::{Three, observation};
use crate::camera::CarvedGrid;
use crate::failures::invalid;
use beo_core::grid::{Observation, Outside, View};
use beo_core::perception::{CompletionFrame, PoseSearch, Query, ScaleSearch};
use beo_ipc::{ObservationHeader, Unit, tasks};
use nalgebra::Vector3;
use pyo3::prelude::*;

/// What is known of the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pose {
    /// The grid stands as the training shapes do.
    Known,
    /// A turn about the vertical axis.
    Yaw,
    /// Any rotation.
    Full,
    /// The poses in which the class comes to rest, and a turn.
    Rest,
}

/// The arguments of a question, as they were given.
#[derive(Debug)]
pub struct Asked {
    /// `pose`.
    pub pose: Option<String>,
    /// `yaw_span_deg`.
    pub yaw_span_deg: f64,
    /// `view`.
    pub view: Option<String>,
    /// `camera`, voxels from the grid's centre.
    pub camera: Option<Three>,
    /// `size`.
    pub size: Option<String>,
    /// `voxel_size_m`.
    pub voxel_size_m: Option<f64>,
    /// `completion`.
    pub completion: bool,
    /// `frame`.
    pub frame: String,
}

/// A grid, and what is asked about it.
#[derive(Debug)]
pub struct Question {
    /// The grid.
    pub observation: Observation,
    /// Where a grid of a depth image lies, in the camera's frame.
    pub carved: Option<beo_ipc::CarvedGrid>,
    pose: Pose,
    yaw_span_rad: f64,
    seen_from_above: bool,
    camera_m: Option<Vector3<f64>>,
    scale: ScaleSearch,
    /// Edge of a voxel, metres, where it is known.
    pub voxel_size_m: Option<f64>,
    completion: bool,
    frame: CompletionFrame,
}

impl Question {
    /// Reads a grid (an array or a [`CarvedGrid`]) and the arguments that go with it.
    pub fn read(grid: &Bound<'_, PyAny>, asked: &Asked) -> PyResult<Self> {
        let pose = match asked.pose.as_deref() {
            None => None,
            Some("known") => Some(Pose::Known),
            Some("yaw") => Some(Pose::Yaw),
            Some("full") => Some(Pose::Full),
            Some("rest") => Some(Pose::Rest),
            Some(other) => return Err(invalid(format!("pose is {other:?}: use \"known\", \"yaw\", \"full\" or \"rest\""))),
        };
        let span = asked.yaw_span_deg;
        if !(span > 0.0 && span <= 360.0) {
            return Err(invalid(format!("yaw_span_deg is {span}: use degrees above 0, at most 360")));
        }
        let frame = match asked.frame.as_str() {
            "grid" => CompletionFrame::Grid,
            "object" => CompletionFrame::Object,
            other => return Err(invalid(format!("frame is {other:?}: use \"grid\" or \"object\""))),
        };
        if let Ok(carved) = grid.cast::<CarvedGrid>() {
            return Self::of_carved(carved.get(), pose, frame, asked);
        }
        let seen_from_above = match asked.view.as_deref() {
            None => false,
            Some("top") => true,
            Some(other) => {
                return Err(invalid(format!("view is {other:?}: use \"top\", or leave it out; of a camera, say where it is by `camera`")));
            }
        };
        if let Some(size) = asked.voxel_size_m.filter(|size| !((*size as f32).is_finite() && *size as f32 > 0.0)) {
            return Err(invalid(format!("voxel_size_m is {size}: the edge of a voxel in metres, positive and finite")));
        }
        let camera_m = asked.camera.map(|Three(camera)| Vector3::from(camera) * asked.voxel_size_m.unwrap_or(1.0));
        if camera_m.is_some_and(|camera| !camera.iter().all(|v| (*v as f32).is_finite()) || camera.iter().all(|v| *v as f32 == 0.0)) {
            return Err(invalid("camera: give its place in voxels from the grid's centre, three finite numbers that are not all 0"));
        }
        if seen_from_above && camera_m.is_some() {
            return Err(invalid("view \"top\" and `camera` contradict each other: leave one out"));
        }
        let scale = match asked.size.as_deref() {
            None | Some("known") => ScaleSearch::Known,
            Some("search") if camera_m.is_some() => ScaleSearch::Search { side: None },
            Some("search") => {
                return Err(invalid("size \"search\": size and place are searched in what a camera sees; say where it is by `camera`"));
            }
            Some(other) => return Err(invalid(format!("size is {other:?}: use \"known\" or \"search\""))),
        };
        let pose = pose.unwrap_or(Pose::Known);
        if pose == Pose::Rest && camera_m.is_none() {
            return Err(invalid("pose \"rest\" is searched in what a camera sees: say where it is by `camera`"));
        }
        let question = Self {
            observation: observation(grid)?,
            carved: None,
            pose,
            yaw_span_rad: asked.yaw_span_deg.to_radians(),
            seen_from_above,
            camera_m,
            scale,
            voxel_size_m: asked.voxel_size_m,
            completion: asked.completion,
            frame,
        };
        question.possible()
    }

    /// A grid of a depth image says itself what is known.
    fn of_carved(carved: &CarvedGrid, pose: Option<Pose>, frame: CompletionFrame, asked: &Asked) -> PyResult<Self> {
        let given = [
            ("view", asked.view.is_some()),
            ("camera", asked.camera.is_some()),
            ("size", asked.size.is_some()),
            ("voxel_size_m", asked.voxel_size_m.is_some()),
        ];
        if let Some((name, _)) = given.iter().find(|(_, is_given)| *is_given) {
            return Err(invalid(format!("{name}: a CarvedGrid says it itself; leave it out")));
        }
        let place = carved.place;
        let question = Self {
            observation: carved.observation.clone(),
            carved: Some(place),
            pose: pose.unwrap_or(Pose::Rest),
            yaw_span_rad: asked.yaw_span_deg.to_radians(),
            seen_from_above: false,
            camera_m: Some(Vector3::from(place.camera_position_m)),
            scale: ScaleSearch::Search { side: None },
            voxel_size_m: Some(place.voxel_size_m),
            completion: asked.completion,
            frame,
        };
        question.possible()
    }

    fn possible(self) -> PyResult<Self> {
        if self.pose == Pose::Full && self.scale != ScaleSearch::Known {
            return Err(invalid(beo_ipc::Refusal::RotationAndSize));
        }
        Ok(self)
    }

    /// The query for a model in this process.
    pub fn query(&self) -> Query {
        // Lengths as a header carries them, in single precision: a model in this process then answers as a daemon does.
        let carried = |length: f64| f64::from(length as f32);
        let voxel_size_m = self.voxel_size_m.map(carried);
        Query {
            pose: match self.pose {
                Pose::Known => PoseSearch::Known,
                Pose::Yaw => PoseSearch::Yaw { span: self.yaw_span_rad },
                Pose::Rest => PoseSearch::YAW,
                Pose::Full => PoseSearch::Full,
            },
            lying: self.pose == Pose::Rest,
            view: self.seen_from_above.then_some(View::Top),
            camera: self.camera_m.map(|camera| camera.map(carried) / voxel_size_m.unwrap_or(1.0)),
            outside: if self.camera_m.is_some() { Outside::Unknown } else { Outside::Empty },
            scale: self.scale,
            is_cut: self.carved.is_some_and(|place| place.cut != 0),
            voxel_size_m,
            completion: self.completion,
            frame: self.frame,
            ..Query::default()
        }
    }

    /// The header for a daemon.
    pub fn header(&self) -> PyResult<ObservationHeader> {
        let dims = <[usize; 3]>::from(self.observation.dims()).map(|side| side as u32);
        let voxel = self.voxel_size_m.unwrap_or(1.0);
        let pose_search = match self.pose {
            Pose::Known => beo_ipc::PoseSearch::Known,
            Pose::Yaw => beo_ipc::PoseSearch::Yaw,
            Pose::Full => beo_ipc::PoseSearch::Full,
            Pose::Rest => beo_ipc::PoseSearch::Rest,
        };
        let mut header = match &self.carved {
            Some(place) => ObservationHeader::of_grid(place).map_err(invalid)?,
            None => ObservationHeader::new(dims),
        };
        header.pose_search = pose_search.code();
        header.tasks = if self.completion { tasks::ALL } else { tasks::CLASS | tasks::POSE };
        header.completion_frame = match self.frame {
            CompletionFrame::Grid => beo_ipc::CompletionFrame::Grid.code(),
            CompletionFrame::Object => beo_ipc::CompletionFrame::Object.code(),
        };
        if self.carved.is_some() {
            return Ok(header);
        }
        header.voxel_size_m = voxel as f32;
        header.unit = if self.voxel_size_m.is_some() { Unit::Metres } else { Unit::Unknown }.code();
        if self.seen_from_above {
            header.view = beo_ipc::View::TopDown.code();
        }
        if let Some(camera) = self.camera_m {
            header.view = beo_ipc::View::Camera.code();
            header.outside = beo_ipc::Outside::Unknown.code();
            header.sensor_position_m = camera.map(|v| v as f32).into();
        }
        if self.scale != ScaleSearch::Known {
            header.scale_search = beo_ipc::ScaleSearch::Search.code();
        }
        Ok(header)
    }
}
