//! Pictures, as PNG: voxels in isometric view, what was perceived, simple charts, sheets of pictures with captions.

mod canvas;
mod palette;
mod perceived;
mod plot;
mod scenes;
mod voxels;

pub use canvas::{Anchor, Colour, Image, MOST_UNSURE, SaveError, TextSize, png_of, sheet};
pub use palette::viridis;
pub use perceived::Perceived;
pub use plot::{Chart, WeightedSeries};
pub use scenes::{
    completed, draw_completion, draw_deviation, draw_observation, draw_poses, draw_probability, draw_shape, draw_weights, seen,
};
pub use voxels::draw_voxels;
