//! What an observation says of a grid that was carved from a frame.

use beo_camera::Grid;
use beo_ipc::{CarvedGrid, CarvedGridError, ObservationHeader};

/// The header of the grid of the object with this label. `known_side_m` is the object's longest side, metres, where it is known.
///
/// # Errors
/// [`CarvedGridError`] if no daemon would take it.
pub fn observation_of(object: u16, grid: &Grid, known_side_m: Option<f64>) -> Result<ObservationHeader, CarvedGridError> {
    let place = grid.grid_to_camera();
    let dims = grid.dims().map(|side| side as u32);
    ObservationHeader::of_grid(&CarvedGrid {
        voxel_size_m: grid.voxel_size_m(),
        position_m: place.translation.vector.into(),
        orientation: place.rotation.coords.into(),
        camera_position_m: grid.camera().into(),
        object_id: object.into(),
        known_side_m: known_side_m.unwrap_or(0.0),
        ..CarvedGrid::new(dims)
    })
}
