//! From where objects are seen in an evaluation, and what is asked then.

use super::metrics::{PlacementErrors, PoseErrors};
use super::rotations::draw_rotation;
use super::symmetry::{Symmetries, rotation_error};
use beo_camera::Fusion;
use beo_core::grid::{Observation, Occupancy, Outside, Rotation, Similarity, Turn, View, yaw};
use beo_core::learning::Shape;
use beo_core::perception::{Percept, PoseSearch, Query, ScaleSearch};
use beo_core::simulation::{self, Conditions, Eye};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// From where objects are seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "view", rename_all = "lowercase")]
pub enum Viewpoint {
    /// Straight from above, orthographic: the paper's.
    Top,
    /// By a pinhole camera.
    Camera {
        /// Above the horizontal, degrees.
        elevation_deg: f64,
        /// Each object is seen from so many directions around it, one query each.
        azimuths: usize,
        /// Distance to the object's centre, in longest sides of the object.
        distance: f64,
        /// So many views, spread around the object, are fused into one grid.
        fused: usize,
        /// Whether size and place are to be found, in a grid laid about what is visible; else the grid is the object's own.
        scale_search: bool,
    },
}

impl Viewpoint {
    /// Queries per object.
    pub fn azimuths(&self) -> usize {
        match self {
            Self::Top => 1,
            Self::Camera { azimuths, .. } => *azimuths,
        }
    }

    /// For tables: nothing for views from above.
    pub fn label(&self) -> String {
        match self {
            Self::Top => String::new(),
            Self::Camera { elevation_deg, fused: 1, .. } => format!(" {elevation_deg:.0}°"),
            Self::Camera { elevation_deg, fused, .. } => format!(" {elevation_deg:.0}° ×{fused}"),
        }
    }

    /// Sets in `query` what it says of the view.
    pub fn ask(&self, query: &mut Query) {
        match self {
            Self::Top => query.view = Some(View::Top),
            Self::Camera { scale_search, .. } => {
                query.view = None;
                // A camera's grid may end within the object.
                query.outside = Outside::Unknown;
                query.scale = if *scale_search { ScaleSearch::Search { side: None } } else { ScaleSearch::Known };
            }
        }
    }
}

/// A shape as it is asked about.
pub struct Posed {
    /// How it truly lies in the grid.
    pub placed: Similarity,
    /// The object in the grid.
    pub object: Occupancy,
    /// The observation of it.
    pub observation: Observation,
    /// Where the camera was, in voxels from the grid's centre.
    pub camera: Option<Vector3<f64>>,
}

impl Posed {
    /// The query at `place` among all: its shape, turned as drawn with `seed`, seen from `viewpoint`.
    pub fn new(shape: &Shape, pose: PoseSearch, viewpoint: Viewpoint, seed: u64, place: usize) -> Self {
        let rotation = draw_rotation(pose, seed, place);
        let object = match pose {
            PoseSearch::Known => shape.object.clone(),
            _ => Turn::new(shape.object.dims(), &rotation).occupancy(&shape.object),
        };
        let Viewpoint::Camera { elevation_deg, azimuths, distance, fused, scale_search } = viewpoint else {
            let observation = View::Top.of(&object);
            return Self { placed: Similarity::turned(rotation), object, observation, camera: None };
        };
        let dims = object.dims();
        let size = object.bounds().map_or(1, |[low, high]| (0..3).map(|a| high[a] - low[a]).max().unwrap_or(1)) as f64;
        let first = (place % azimuths) as f64 * TAU / azimuths as f64;
        let eye = |view: usize| Eye {
            azimuth: first + view as f64 * TAU / fused as f64,
            elevation: elevation_deg.to_radians(),
            distance: distance * size,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let see = |view: usize| simulation::RenderedView::new(&object, &eye(view), &Conditions::default(), &mut rng);
        let views: Vec<simulation::RenderedView> = (0..fused).filter_map(see).collect();
        // Axes of the grid, its centre and the edge of its voxels, in the object's.
        let (mut axes, mut centre, mut edge) = (Rotation::identity(), Vector3::zeros(), 1.0);
        if scale_search && let Some(view) = views.first() {
            axes = if pose == PoseSearch::Known { axes } else { yaw(eye(0).azimuth + PI) };
            let points: Vec<Vector3<f64>> = view.points().iter().map(|p| axes.inverse() * p.coords).collect();
            let ends = points.first().map(|first| points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p))));
            if let Some((low, high)) = ends {
                centre = axes * ((low + high) / 2.0);
                // The rule of `beo_camera::place`: what is visible takes two thirds.
                let side = dims.x().min(dims.y()).min(dims.z()) as f64;
                edge = ((high - low).max() / (beo_camera::Placement::default().share * side)).max(1e-3);
            }
        }
        let (mut bytes, mut observation) = (Vec::new(), Observation::unknown(dims));
        if let [view] = &views[..] {
            view.carve(dims, &axes, &centre, edge, &mut bytes, &mut observation);
        } else {
            let mut fusion = Fusion::new(dims.voxels());
            for view in &views {
                view.carve(dims, &axes, &centre, edge, &mut bytes, &mut observation);
                observation.write(&mut bytes);
                fusion.add(&bytes).expect("grids of one size and the three codes");
            }
            bytes.resize(dims.voxels(), 0);
            fusion.write(&mut bytes).expect("a grid of the same size");
            observation.read(&bytes).expect("the three codes");
        }
        let into_grid = |point: Vector3<f64>| axes.inverse() * (point - centre) / edge;
        let placed = Similarity { rotation: axes.inverse() * rotation, scale: 1.0 / edge, translation_voxels: into_grid(Vector3::zeros()) };
        let object = if scale_search {
            let mut turn = Turn::new(dims, &Rotation::identity());
            turn.set_to_grid(&placed);
            turn.occupancy(&shape.object)
        } else {
            object
        };
        let camera = (fused == 1).then(|| into_grid(eye(0).position()));
        Self { placed, object, observation, camera }
    }

    /// How far an estimate is from the truth, raw and by the symmetries of the shape.
    pub fn errors(&self, shape: &Shape, pose: PoseSearch, estimate: &Rotation) -> PoseErrors {
        let symmetries = match pose {
            PoseSearch::Full => Symmetries::full(&shape.object),
            _ => Symmetries::yaw(&shape.object),
        };
        PoseErrors {
            raw_deg: rotation_error(estimate, &self.placed.rotation).to_degrees(),
            symmetry_aware_deg: symmetries.error(estimate, &self.placed.rotation).to_degrees(),
        }
    }

    /// How far size and place are from the truth, as shares of the object's longest side, and in deviations that were answered.
    pub fn placement_errors(&self, shape: &Shape, percept: &Percept) -> PlacementErrors {
        let [low, high] = shape.object.bounds().unwrap_or([[0; 3], [1; 3]]);
        let lengths: [f64; 3] = std::array::from_fn(|axis| (high[axis] - low[axis]) as f64 * self.placed.scale);
        let longest = lengths.into_iter().fold(0.0, f64::max);
        let away = percept.placed.translation_voxels - self.placed.translation_voxels;
        let mut errors = PlacementErrors {
            centre: away.norm() / longest,
            size: (percept.placed.scale / self.placed.scale).ln().abs(),
            ..PlacementErrors::default()
        };
        if let Some(found) = &percept.object_box {
            let deviations = |error: f64, deviation: f64| error / deviation.max(1e-6);
            errors.centre_deviations = std::array::from_fn(|axis| deviations(away[axis], found.position_deviation_voxels[axis]));
            errors.extent_deviations =
                std::array::from_fn(|axis| deviations(found.extent_voxels[axis] - lengths[axis], found.extent_deviation_voxels[axis]));
            errors.extent = (0..3).map(|axis| (found.extent_voxels[axis] - lengths[axis]).abs()).sum::<f64>() / (3.0 * longest);
        }
        errors
    }
}
