//! The filled voxels of a completion, in the frame of the image.

use crate::covariance::rotation;
use beo_ipc::{CompletionFrame, CompletionHeader};
use nalgebra::Vector3;

/// A voxel that is filled more probably than not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voxel {
    /// Its centre, metres.
    pub position_m: [f64; 3],
    /// Probability of being filled.
    pub occupancy: f32,
    /// Standard deviation of that; 0 where it was seen.
    pub deviation: f32,
    /// Whether a side of it is bare.
    pub is_outer: bool,
}

/// The filled voxels; none where header and payload contradict each other.
pub fn filled(header: &CompletionHeader, occupancy: &[u8], deviation: &[u8]) -> Vec<Voxel> {
    let [nx, ny, nz] = header.dims.map(|side| side as usize);
    let count = nx.checked_mul(ny).and_then(|layer| layer.checked_mul(nz));
    if count != Some(occupancy.len()) || deviation.len() != occupancy.len() {
        return Vec::new();
    }
    let mut turn = rotation(header.orientation);
    if header.frame == CompletionFrame::Object.code() {
        turn *= rotation(header.rotation_object_to_grid.map(f64::from));
    }
    let is_filled = |voxel: usize| occupancy[voxel] >= 128;
    let middle = header.dims.map(|side| 0.5 * f64::from(side) - 0.5);
    let (edge, origin) = (f64::from(header.voxel_size_m), Vector3::from(header.position_m));
    let mut voxels = Vec::new();
    for voxel in (0..occupancy.len()).filter(|voxel| is_filled(*voxel)) {
        let [x, y, z] = [voxel / (ny * nz), voxel / nz % ny, voxel % nz];
        let inner = [(x, nx, ny * nz), (y, ny, nz), (z, nz, 1)]
            .into_iter()
            .all(|(at, side, step)| at > 0 && at + 1 < side && is_filled(voxel - step) && is_filled(voxel + step));
        let local = Vector3::new(x as f64 - middle[0], y as f64 - middle[1], z as f64 - middle[2]) * edge;
        voxels.push(Voxel {
            position_m: (origin + turn * local).into(),
            occupancy: f32::from(occupancy[voxel]) / 255.0,
            deviation: f32::from(deviation[voxel]) / 255.0,
            is_outer: !inner,
        });
    }
    voxels
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_ipc::ObservationHeader;

    fn header() -> CompletionHeader {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let observation = ObservationHeader {
            position_m: [1.0, 2.0, 3.0],
            // A quarter turn about z: x becomes y.
            orientation: [0.0, 0.0, half, half],
            voxel_size_m: 0.5,
            ..ObservationHeader::new([8, 9, 10])
        };
        CompletionHeader::answering(&observation)
    }

    #[test]
    fn a_voxel_lies_where_the_grid_says() {
        let mut occupancy = vec![0; 720];
        // (7, 4, 2) of 8 × 9 × 10.
        occupancy[7 * 90 + 4 * 10 + 2] = 204;
        occupancy[0] = 127;
        let found = filled(&header(), &occupancy, &vec![51; 720]);
        assert_eq!(found.len(), 1);
        let expected = [1.0, 2.0 + 0.5 * 3.5, 3.0 - 0.5 * 2.5];
        assert!(found[0].position_m.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        assert_eq!((found[0].occupancy, found[0].deviation, found[0].is_outer), (0.8, 0.2, true));
    }

    #[test]
    fn voxels_within_are_told_from_those_outside() {
        let found = filled(&header(), &[255; 720], &[0; 720]);
        assert_eq!((found.len(), found.iter().filter(|voxel| !voxel.is_outer).count()), (720, 6 * 7 * 8));
    }

    #[test]
    fn a_payload_that_contradicts_its_header_holds_nothing() {
        assert!(filled(&header(), &[255; 719], &[0; 719]).is_empty());
        assert!(filled(&header(), &[255; 720], &[0; 719]).is_empty());
        let huge = CompletionHeader { dims: [u32::MAX; 3], ..header() };
        assert!(filled(&huge, &[255; 720], &[0; 720]).is_empty());
    }
}
