//! The surface of a completion: where the occupancy probability passes ½, by naive surface nets (Gibson, "Constrained Elastic Surface
//! Nets", 1998; one vertex for every cube of eight voxel centres that the surface passes, at the mean of where it crosses the cube's edges).

use super::GridPlacement;
use beo_core::grid::Dims;
use beo_picture::Colour;
use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use nalgebra::{Point3, Vector3};

/// A corner of the surface's triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Where it is, metres.
    pub position_m: [f64; 3],
    /// Points outward; unit length.
    pub normal: [f32; 3],
    /// Standard deviation of the occupancy about here: 0 where it was observed.
    pub deviation: f32,
    /// As in the pictures: what was seen in one colour, what is predicted in another, the paler the less sure.
    pub rgb: [u8; 3],
}

/// A closed surface of triangles whose corners run counter-clockwise when seen from outside. Every edge is in two triangles; where parts of
/// the object touch in an edge only, in four.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// The corners.
    pub vertices: Vec<Vertex>,
    /// Three indices into the vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// The surface at probability ½ of a completed grid, where the grid lies. What is outside the grid is empty, so that the surface closes at
/// its border. `occupancy` and `deviation` have one value per voxel; filled voxels without deviation are those that were observed.
///
/// An object without a voxel of at least ½ has no surface.
pub fn surface_of(dims: Dims, occupancy: &[f32], deviation: &[f32], placement: &GridPlacement) -> Surface {
    assert_eq!((occupancy.len(), deviation.len()), (dims.voxels(), dims.voxels()), "one value per voxel each");
    let padded = Padded::new(dims);
    let mut below_half = vec![0.5_f32; padded.shape.usize()];
    for (voxel, p) in occupancy.iter().enumerate() {
        // A voxel of exactly ½ is filled.
        below_half[padded.index(dims.coordinates(voxel))] = if *p >= 0.5 { (0.5 - p).min(-1e-6) } else { (0.5 - p).max(1e-6) };
    }
    let mut net = SurfaceNetsBuffer::default();
    surface_nets(&below_half, &padded.shape, [0; 3], padded.last, &mut net);
    let triangles: Vec<[u32; 3]> = net.indices.as_chunks::<3>().0.to_vec();
    // The centre of the voxel (i, j, k) is the sample (i + 1, j + 1, k + 1).
    let positions: Vec<Point3<f64>> =
        net.positions.iter().map(|sample| placement.place(dims, sample.map(|side| f64::from(side) - 0.5))).collect();
    let look = Look { dims, occupancy, deviation };
    let vertices = positions.iter().zip(normals(&positions, &triangles)).zip(&net.positions).map(|((position, normal), sample)| {
        let (deviation, seen) = look.at(*sample);
        Vertex { position_m: (*position).into(), normal, deviation, rgb: Colour::predicted(deviation).mix(Colour::KNOWN, seen).rgb }
    });
    Surface { vertices: vertices.collect(), triangles }
}

/// The grid with a border of empty samples around it, in the order of `fast_surface_nets`, x fastest: one sample below and two above, since
/// the last cube along an axis gets no faces across it.
struct Padded {
    shape: RuntimeShape<u32, 3>,
    last: [u32; 3],
}

impl Padded {
    fn new(dims: Dims) -> Self {
        let last = <[usize; 3]>::from(dims).map(|side| side as u32 + 2);
        Self { shape: RuntimeShape::<u32, 3>::new(last.map(|side| side + 1)), last }
    }

    fn index(&self, voxel: [usize; 3]) -> usize {
        self.shape.linearize(voxel.map(|side| side as u32 + 1)) as usize
    }
}

/// The completion, interpolated between voxel centres.
struct Look<'a> {
    dims: Dims,
    occupancy: &'a [f32],
    deviation: &'a [f32],
}

impl Look<'_> {
    /// Deviation at a padded sample, and the share of what is filled about it that was observed. Both are weighted as in trilinear
    /// interpolation, over the filled voxels only: those outside are not part of the object.
    fn at(&self, sample: [f32; 3]) -> (f32, f32) {
        let (mut weight, mut deviation, mut seen) = (0.0, 0.0, 0.0);
        for corner in 0..8_usize {
            let low = sample.map(f32::floor);
            let mut share = 1.0;
            let mut voxel = [0_usize; 3];
            for axis in 0..3 {
                let (upper, fraction) = (corner >> axis & 1, sample[axis] - low[axis]);
                share *= if upper == 1 { fraction } else { 1.0 - fraction };
                // One less for the border; samples of it wrap to a number that no side reaches.
                voxel[axis] = (low[axis] as usize + upper).wrapping_sub(1);
            }
            let sides = <[usize; 3]>::from(self.dims);
            if voxel.iter().zip(sides).any(|(at, side)| *at >= side) {
                continue;
            }
            let index = self.dims.index(voxel[0], voxel[1], voxel[2]);
            if self.occupancy[index] >= 0.5 {
                weight += share;
                deviation += share * self.deviation[index];
                seen += if self.deviation[index] == 0.0 { share } else { 0.0 };
            }
        }
        if weight > 0.0 { (deviation / weight, seen / weight) } else { (0.0, 0.0) }
    }
}

/// A normal for each vertex: the mean of its triangles', weighted by their area.
fn normals(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![Vector3::zeros(); positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
        let twice_area = (b - a).cross(&(c - a));
        triangle.iter().for_each(|corner| sums[*corner as usize] += twice_area);
    }
    // Triangles that cancel each other leave no direction.
    sums.iter().map(|sum| sum.try_normalize(f64::MIN_POSITIVE).unwrap_or(Vector3::z()).cast::<f32>().into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::uniform_rotation;
    use std::collections::HashMap;
    use std::f64::consts::PI;

    /// A ball in a grid: 1 inside, 0 outside, and between them over a voxel's length.
    fn ball(dims: Dims, centre: [f64; 3], radius: f64) -> Vec<f32> {
        let value = |voxel: usize| {
            let at = dims.coordinates(voxel).map(|side| side as f64 + 0.5);
            let distance = (Point3::from(at) - Point3::from(centre)).norm();
            (0.5 + radius - distance).clamp(0.0, 1.0) as f32
        };
        (0..dims.voxels()).map(value).collect()
    }

    fn volume(surface: &Surface) -> f64 {
        let corner = |at: u32| Vector3::from(surface.vertices[at as usize].position_m);
        surface.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
    }

    /// How often each directed edge occurs.
    fn edges(surface: &Surface) -> HashMap<(u32, u32), usize> {
        let mut count = HashMap::new();
        for [a, b, c] in &surface.triangles {
            [(a, b), (b, c), (c, a)].into_iter().for_each(|(from, to)| *count.entry((*from, *to)).or_default() += 1);
        }
        count
    }

    fn is_closed(surface: &Surface) -> bool {
        let edges = edges(surface);
        edges.iter().all(|((from, to), count)| *count == 1 && edges.get(&(*to, *from)) == Some(&1))
    }

    #[test]
    fn the_surface_of_a_ball_is_closed_outward_and_in_its_place() {
        let dims = Dims::new(24, 26, 28).unwrap();
        let (centre, radius) = ([10.2, 13.9, 15.1], 8.3);
        let rotation = uniform_rotation([0.3, 0.6, 0.8]);
        let placement = GridPlacement { position_m: [0.4, -1.2, 0.9], orientation: rotation, voxel_size_m: 0.02 };
        let surface = surface_of(dims, &ball(dims, centre, radius), &vec![0.1; dims.voxels()], &placement);
        assert!(is_closed(&surface), "every edge is in two triangles, once in each direction");
        let radius_m = radius * 0.02;
        let expected = 4.0 / 3.0 * PI * radius_m.powi(3);
        // Its vertices are means of points on the ball, so inside it: by a few hundredths of a voxel here.
        assert!((0.98..1.0).contains(&(volume(&surface) / expected)), "{} for {expected}", volume(&surface));
        // Closed form: the ball's centre from the grid's, turned and scaled.
        let offset = Vector3::new(10.2 - 12.0, 13.9 - 13.0, 15.1 - 14.0) * 0.02;
        let middle = Point3::new(0.4, -1.2, 0.9) + rotation * offset;
        for vertex in &surface.vertices {
            let outward = Point3::from(vertex.position_m) - middle;
            assert!((outward.norm() / radius_m - 1.0).abs() < 0.03, "{} m", outward.norm());
            let normal = Vector3::from(vertex.normal).cast::<f64>();
            assert!((normal.norm() - 1.0).abs() < 1e-6 && normal.dot(&outward.normalize()) > 0.97, "{normal} at {outward}");
        }
    }

    #[test]
    fn what_reaches_the_grids_border_is_closed_there() {
        let dims = Dims::cube(8).unwrap();
        let full = surface_of(dims, &vec![1.0; 512], &vec![0.0; 512], &GridPlacement::default());
        assert!(is_closed(&full));
        // Half a voxel beyond the outermost centres: the whole grid, but for its edges and corners.
        assert!((volume(&full) / 512.0 - 1.0).abs() < 0.05, "{}", volume(&full));
        assert_eq!(surface_of(dims, &vec![0.49; 512], &vec![0.1; 512], &GridPlacement::default()), Surface::default());
        let half = surface_of(dims, &vec![0.5; 512], &vec![0.1; 512], &GridPlacement::default());
        assert!(is_closed(&half) && !half.triangles.is_empty(), "a probability of ½ is filled");
    }

    #[test]
    fn vertices_carry_the_deviation_of_what_is_filled_about_them() {
        let dims = Dims::cube(16).unwrap();
        let occupancy = ball(dims, [8.0; 3], 5.0);
        // Seen from above; below the middle it is a guess.
        let deviation: Vec<f32> = (0..dims.voxels()).map(|v| if dims.coordinates(v)[2] >= 8 { 0.0 } else { 0.3 }).collect();
        let surface = surface_of(dims, &occupancy, &deviation, &GridPlacement::default());
        for vertex in &surface.vertices {
            match vertex.position_m[2] {
                z if z > 1.0 => assert_eq!((vertex.deviation, vertex.rgb), (0.0, Colour::KNOWN.rgb)),
                z if z < -1.0 => {
                    assert!((vertex.deviation - 0.3).abs() < 1e-6);
                    assert_eq!(vertex.rgb, Colour::predicted(vertex.deviation).rgb);
                }
                _ => assert!((0.0..=0.3001).contains(&vertex.deviation)),
            }
        }
    }
}
