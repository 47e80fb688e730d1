//! Congealing: unaligned shapes of one kind are brought to one pose by lowering the entropy of their stack.
//!
//! E. Learned-Miller, "Data driven image models through continuous joint alignment", IEEE Transactions on Pattern Analysis and Machine
//! Intelligence 28(2), 2006. There it is images under affine maps; here it is shapes under rotation, scale and translation:
//!
//! 1. every shape on its own: centre of mass, root mean square radius, principal axes (`start`);
//! 2. which way round: each by the shapes most like it (`tree`);
//! 3. coordinate descent on the entropy of the mean occupancy, coarse to fine (`objective`, `descent`);
//! 4. after each descent all other ways round are tried again (`flips`);
//! 5. the aligned class is laid along the axes of the unit cube (`canonical`).
//!
//! The same shapes and seed give the same result on any number of threads.

mod canonical;
mod descent;
mod flips;
mod objective;
mod settings;
mod solid;
mod start;
mod transform;
mod tree;

pub use objective::binary_entropy;
pub use settings::{AlignmentSettings, LONGEST};
pub use solid::{Solid, grid_point};
pub use transform::ShapeSimilarity;

use beo_core::grid::Rotation;
use descent::Stage;
use objective::Stack;
use solid::Level;

/// A way of placing all shapes, and how well they agree then.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Input to output coordinates, one for each shape.
    pub placements: Vec<ShapeSimilarity>,
    /// Entropy of the stack in bits, summed over the cells.
    pub entropy: f64,
    /// Mean occupancy of each cell of the unit cube, in C order.
    pub mean: Vec<f32>,
}

/// Shapes of one class before and after.
#[derive(Clone, Debug)]
pub struct Congealed {
    /// As they came, centred by their boxes and scaled by their longest sides.
    pub before: Placed,
    /// Along their principal axes, all with the same root mean square radius.
    pub normalised: Placed,
    /// Aligned.
    pub after: Placed,
    /// Entropy in the course of the descents, coarse to fine, one list for each: it never rises within one.
    pub descents: Vec<Vec<f64>>,
    /// How many times a shape was found to lie the wrong way round after a descent.
    pub flipped: usize,
}

/// Aligns shapes of one class; `progress` is called as the work goes on, with a share from 0 to 1. There must be at least one shape.
pub fn congeal(solids: &[Solid], settings: &AlignmentSettings, progress: impl Fn(f64)) -> Congealed {
    let count = solids.len() as f64;
    // The mean of the longest sides as they are is about what they come to in the end.
    let relative = solids.iter().map(|solid| solid.longest() / solid.radius).sum::<f64>() / count;
    let units = solids.iter().map(|solid| LONGEST / (relative * solid.radius)).collect();
    let stage = Stage { solids, settings, units };
    let normalised = stage.normalised();
    let tree = stage.along_tree(&normalised);
    progress(0.4);
    let (mut poses, mut descents, mut flipped) = (tree.state.poses, Vec::new(), 0);
    for (level, share) in [(Level::Coarse, 0.6), (Level::Middle, 0.9), (Level::Fine, 1.0)] {
        let (mut state, mut history) = (stage.state(level, &poses), Vec::new());
        // What lies the wrong way round is found as well on a coarser grid, in a fraction of the time.
        match level {
            Level::Fine => stage.descend(level, &mut state, &mut history),
            _ => flipped += stage.descend_with_flips(level, &mut state, &tree.neighbours, &mut history),
        }
        tracing::debug!(?level, from = history.first(), to = state.entropy, rounds = history.len(), "descended");
        descents.push(history);
        poses = state.poses;
        progress(share);
    }

    let similarities = |poses: &[transform::Pose]| poses.iter().enumerate().map(|(i, pose)| stage.similarity(i, pose)).collect::<Vec<_>>();
    let aligned = similarities(&poses);
    let after = canonical::to_unit_cube(solids, &aligned, settings);
    let along_axes = similarities(&normalised);
    let normal = canonical::into_cube(solids, &along_axes, ShapeSimilarity::turning(Rotation::identity()));
    let placed = |placements: Vec<ShapeSimilarity>| measured(solids, settings, placements);
    Congealed {
        before: placed(solids.iter().map(Solid::as_it_is).collect()),
        normalised: placed(along_axes.iter().map(|p| normal.after(p)).collect()),
        after: placed(aligned.iter().map(|p| after.after(p)).collect()),
        descents,
        flipped,
    }
}

/// How well shapes agree that are placed in the unit cube.
pub fn measured(solids: &[Solid], settings: &AlignmentSettings, placements: Vec<ShapeSimilarity>) -> Placed {
    let mut stack = Stack::new(Level::Fine, settings.resolution, solids.len());
    // Within the unit cube nothing leaves the canvas.
    solids.iter().zip(&placements).for_each(|(solid, placement)| {
        stack.add(solid, placement);
    });
    Placed { entropy: stack.entropy(), mean: stack.mean_in_unit_cube(settings.resolution), placements }
}

#[cfg(test)]
mod tests;
