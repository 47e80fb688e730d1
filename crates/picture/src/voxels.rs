//! Voxels as a shaded isometric picture: seen from above, three faces of each voxel with their own light.
//!
//! The camera stands at −x, −y and above: x runs to the right and back, y to the left and back, z up. So the faces shown are the
//! top (+z), on the left that towards −x, on the right that towards −y, the front of ModelNet's chairs and beds.

use super::{Anchor, Colour, Image, TextSize};
use beo_core::grid::Dims;

/// Light on the top face and on the two side faces.
const LIGHT: [f32; 3] = [1.12, 0.70, 0.90];
/// How much darker the border between faces is that do not continue each other.
const EDGE: f32 = 0.80;
/// Samples per pixel along each axis.
const SAMPLES: usize = 3;
/// How much larger than the whole grid is drawn: shapes take four fifths of it.
const ZOOM: f64 = 1.22;
/// Sine of the elevation: 30° looks down on the top at half its depth.
const TILT: f64 = 0.5;

/// Draws the voxels that `colour` gives a colour, by index, fitted into a picture of `width` × `height` pixels. Translucent
/// voxels let through what is behind them; of a translucent body only its outer faces are drawn.
pub fn draw_voxels(dims: Dims, width: usize, height: usize, colour: impl Fn(usize) -> Option<Colour>) -> Image {
    draw_scene(&Scene::new(dims, width, height), colour, &[])
}

/// From which side a grid is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// From −x, −y and above: the side of the camera, where grids are laid along its view.
    Front,
    /// From +x, +y and above: what a camera does not see.
    Back,
}

/// How a grid is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub dims: Dims,
    /// Pixels.
    pub width: usize,
    pub height: usize,
    pub side: Side,
    /// Voxels that the picture is fitted to, lowest and one above the highest along each axis; those that are drawn if `None`. Pictures
    /// with the same have the same scale.
    pub fitted: Option<[[usize; 3]; 2]>,
}

impl Scene {
    /// From the front, fitted to what is drawn.
    pub fn new(dims: Dims, width: usize, height: usize) -> Self {
        Self { dims, width, height, side: Side::Front, fitted: None }
    }
}

/// Something drawn over the voxels. Places are in voxels from the grid's centre along the grid's axes, widths in pixels.
#[derive(Clone, Debug)]
pub enum Mark {
    /// An arrow.
    Arrow { from: [f64; 3], tip: [f64; 3], colour: Colour, width: f64 },
    /// A line.
    Line { from: [f64; 3], to: [f64; 3], colour: Colour, width: f64 },
    /// Text about its middle.
    Text { at: [f64; 3], text: String, colour: Colour },
}

/// Draws voxels, and marks over them, the last on top.
pub fn draw_scene(scene: &Scene, colour: impl Fn(usize) -> Option<Colour>, marks: &[Mark]) -> Image {
    let Scene { dims, width, height, .. } = *scene;
    // From the back: the grid turned by half a circle about z.
    let turned = |voxel: usize| {
        let [i, j, k] = dims.coordinates(voxel);
        match scene.side {
            Side::Front => voxel,
            Side::Back => dims.index(dims.x() - 1 - i, dims.y() - 1 - j, k),
        }
    };
    let colours: Vec<Option<Colour>> = (0..dims.voxels()).map(|v| colour(turned(v)).filter(|c| c.opacity > 0.0)).collect();
    let mut view = Projection::fit(dims, width * SAMPLES, height * SAMPLES);
    match scene.fitted {
        None => view.zoom(bounds(dims, |v| colours[v].is_some())),
        Some([low, high]) => view.zoom(match scene.side {
            Side::Front => Some([low, high]),
            Side::Back => Some([[dims.x() - high[0], dims.y() - high[1], low[2]], [dims.x() - low[0], dims.y() - low[1], high[2]]]),
        }),
    }
    let mut layer = Layer::new(view.width, view.height);
    let at = |i: usize, j: usize, k: usize| colours[dims.index(i, j, k)];
    // Neighbours towards the camera; what lies beyond the grid is open.
    let above = |[i, j, k]: [usize; 3]| if k + 1 < dims.z() { at(i, j, k + 1) } else { None };
    let left = |[i, j, k]: [usize; 3]| if i > 0 { at(i - 1, j, k) } else { None };
    let right = |[i, j, k]: [usize; 3]| if j > 0 { at(i, j - 1, k) } else { None };
    // Painter's order: from the back (large x and y, small z) to the front.
    for i in (0..dims.x()).rev() {
        for j in (0..dims.y()).rev() {
            for k in 0..dims.z() {
                let Some(colour) = at(i, j, k) else { continue };
                let voxel = [i, j, k];
                // A face is seen unless what lies before it hides it: a solid voxel, or for a translucent one any voxel.
                let is_seen = |before: Option<Colour>| before.is_none_or(|b| b.opacity < 1.0 && colour.opacity >= 1.0);
                let faces = [is_seen(above(voxel)), is_seen(left(voxel)), is_seen(right(voxel))];
                for face in (0..3).filter(|f| faces[*f]) {
                    layer.fill(&view.face(voxel, face), colour.shaded(LIGHT[face]), (voxel_id(dims, voxel), face as u8));
                }
            }
        }
    }
    let middle = <[usize; 3]>::from(dims).map(|n| n as f64 / 2.0);
    let sign = if scene.side == Side::Front { 1.0 } else { -1.0 };
    let place = |at: [f64; 3]| view.point(middle[0] + sign * at[0], middle[1] + sign * at[1], middle[2] + at[2]);
    for mark in marks {
        match mark {
            Mark::Arrow { from, tip, colour, width } => layer.arrow(place(*from), place(*tip), width * SAMPLES as f64, *colour),
            Mark::Line { from, to, colour, width } => layer.line(place(*from), place(*to), width * SAMPLES as f64, *colour),
            Mark::Text { .. } => {}
        }
    }
    let mut image = layer.finish(width, height, view.edge_width());
    for mark in marks {
        if let Mark::Text { at, text, colour } = mark {
            let (x, y) = place(*at);
            let half = (TextSize::Small.width(text) / 2 + 2) as f64;
            // Text is not cut off at the picture's border.
            let keep = |at: f64, margin: f64, end: usize| (at / SAMPLES as f64).clamp(margin, (end as f64 - margin).max(margin));
            let (x, y) = (keep(x, half, width), keep(y, 7.0, height));
            let (x, y, width) = (x.round() as i32, y.round() as i32, TextSize::Small.width(text) as i32);
            // Legible over voxels too.
            image.rectangle(x - width / 2 - 1, y - 6, width as u32 + 2, 13, Colour::PAPER.with_opacity(0.75));
            image.text(text, x, y, TextSize::Small, Anchor::Centre, *colour);
        }
    }
    image
}

/// The box about some voxels: lowest, and one above the highest.
pub fn bounds(dims: Dims, is_in: impl Fn(usize) -> bool) -> Option<[[usize; 3]; 2]> {
    let voxels = (0..dims.voxels()).filter(|v| is_in(*v)).map(|v| dims.coordinates(v));
    voxels.fold(None, |bounds, voxel| {
        let [low, high] = bounds.unwrap_or([voxel, voxel]);
        Some([[0, 1, 2].map(|a| low[a].min(voxel[a])), [0, 1, 2].map(|a| high[a].max(voxel[a] + 1))])
    })
}

/// The grid's axes as small arrows, x, y and z named, in the lower left corner.
pub fn draw_axes(image: &mut Image, side: Side) {
    let sign = if side == Side::Front { 1.0 } else { -1.0 };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let rise = (1.0 - TILT * TILT).sqrt();
    let length = 26.0;
    // The middle of what the three arrows take lies in the corner.
    let origin = (40.0, image.height() as f64 - if side == Side::Front { 16.0 } else { 32.0 });
    let axes = [("x", [sign, 0.0, 0.0]), ("y", [0.0, sign, 0.0]), ("z", [0.0, 0.0, 1.0])];
    for (name, [x, y, z]) in axes {
        let (dx, dy) = (half * (x - y), -(half * TILT * (x + y) + rise * z));
        let end = |t: f64| ((origin.0 + t * dx).round() as i32, (origin.1 + t * dy).round() as i32);
        image.line(end(0.0), end(length), 1, Colour::QUIET);
        let (x, y) = end(length + 9.0);
        image.text(name, x, y, TextSize::Small, Anchor::Centre, Colour::QUIET);
    }
}

fn voxel_id(dims: Dims, [i, j, k]: [usize; 3]) -> u32 {
    dims.index(i, j, k) as u32 + 1
}

/// Orthographic projection in which x and y have the same scale.
struct Projection {
    scale: f64,
    origin: (f64, f64),
    width: usize,
    height: usize,
}

impl Projection {
    fn fit(dims: Dims, width: usize, height: usize) -> Self {
        let [nx, ny, nz] = <[usize; 3]>::from(dims).map(|n| n as f64);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let rise = (1.0 - TILT * TILT).sqrt();
        let wide = half * (nx + ny);
        let tall = half * TILT * (nx + ny) + rise * nz;
        let scale = (0.97 * width as f64 / wide).min(0.97 * height as f64 / tall);
        // Leftmost is (0, ny, ·), rightmost (nx, 0, ·); topmost (nx, ny, nz), lowest (0, 0, 0).
        let left = (width as f64 - scale * wide) / 2.0 + scale * half * ny;
        let bottom = (height as f64 + scale * tall) / 2.0;
        Self { scale, origin: (left, bottom), width, height }
    }

    /// Grids are mostly padded: enlarges about the middle by `ZOOM`, less where a box of voxels would not fit.
    fn zoom(&mut self, fitted: Option<[[usize; 3]; 2]>) {
        let Some([low, high]) = fitted.map(|corners| corners.map(|corner| corner.map(|n| n as f64))) else { return };
        let middle = (self.width as f64 / 2.0, self.height as f64 / 2.0);
        let reach = (0..8).map(|c: usize| {
            let corner = [0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] });
            let (x, y) = self.point(corner[0], corner[1], corner[2]);
            ((x - middle.0) / middle.0).abs().max(((y - middle.1) / middle.1).abs())
        });
        let zoom = (0.98 / reach.fold(0.0, f64::max)).clamp(1.0, ZOOM);
        self.scale *= zoom;
        self.origin = (middle.0 + zoom * (self.origin.0 - middle.0), middle.1 + zoom * (self.origin.1 - middle.1));
    }

    fn point(&self, x: f64, y: f64, z: f64) -> (f64, f64) {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let rise = (1.0 - TILT * TILT).sqrt();
        (self.origin.0 + self.scale * half * (x - y), self.origin.1 - self.scale * (half * TILT * (x + y) + rise * z))
    }

    /// The corners of a face: 0 top, 1 towards −x, 2 towards −y.
    fn face(&self, voxel: [usize; 3], face: usize) -> [(f64, f64); 4] {
        let [x, y, z] = voxel.map(|n| n as f64);
        let corners = match face {
            0 => [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)],
            1 => [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 1.0), (0.0, 1.0, 0.0)],
            _ => [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.0, 0.0, 1.0)],
        };
        corners.map(|(a, b, c)| self.point(x + a, y + b, z + c))
    }

    /// Width of the lines between voxels in samples: a tenth of a voxel, gone where voxels are tiny.
    fn edge_width(&self) -> usize {
        ((self.scale * 0.08).round() as usize).min(2 * SAMPLES)
    }
}

/// Value of marks in place of a voxel and face.
const MARK: (u32, u8) = (u32::MAX, 0);

/// The picture in the making, several samples per pixel.
struct Layer {
    width: usize,
    height: usize,
    colours: Vec<[f32; 3]>,
    /// The voxel and face of the nearest solid or translucent face, for outlines; 0 for paper.
    faces: Vec<(u32, u8)>,
    opacity: Vec<f32>,
}

impl Layer {
    fn new(width: usize, height: usize) -> Self {
        let paper = Colour::PAPER.rgb.map(f32::from);
        let n = width * height;
        Self { width, height, colours: vec![paper; n], faces: vec![(0, 0); n], opacity: vec![0.0; n] }
    }

    /// Fills a convex quadrilateral.
    fn fill(&mut self, corners: &[(f64, f64); 4], colour: Colour, face: (u32, u8)) {
        let extent = |f: fn(&(f64, f64)) -> f64| corners.iter().map(f).fold((f64::MAX, f64::MIN), |(a, b), c| (a.min(c), b.max(c)));
        let (top, bottom) = extent(|p| p.1);
        let rows = (top - 0.5).ceil().max(0.0) as usize..((bottom - 0.5).ceil().max(0.0) as usize).min(self.height);
        for row in rows {
            let y = row as f64 + 0.5;
            let (mut left, mut right) = (f64::MAX, f64::MIN);
            for (n, a) in corners.iter().enumerate() {
                let b = corners[(n + 1) % 4];
                if (a.1 <= y) != (b.1 <= y) {
                    let x = a.0 + (b.0 - a.0) * (y - a.1) / (b.1 - a.1);
                    (left, right) = (left.min(x), right.max(x));
                }
            }
            let columns = (left - 0.5).ceil().max(0.0) as usize..((right - 0.5).ceil().max(0.0) as usize).min(self.width);
            for n in columns.start + row * self.width..(columns.end + row * self.width).max(columns.start + row * self.width) {
                for (below, c) in self.colours[n].iter_mut().zip(colour.rgb) {
                    *below += (f32::from(c) - *below) * colour.opacity;
                }
                self.faces[n] = face;
                self.opacity[n] += (1.0 - self.opacity[n]) * colour.opacity;
            }
        }
    }

    /// Draws a line over everything.
    fn line(&mut self, from: (f64, f64), to: (f64, f64), width: f64, colour: Colour) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy);
        if length > 0.0 {
            let (x, y) = (-dy / length * width / 2.0, dx / length * width / 2.0);
            let corners = [(from.0 + x, from.1 + y), (to.0 + x, to.1 + y), (to.0 - x, to.1 - y), (from.0 - x, from.1 - y)];
            self.fill(&corners, colour, MARK);
        }
    }

    /// Draws an arrow over everything.
    fn arrow(&mut self, from: (f64, f64), tip: (f64, f64), width: f64, colour: Colour) {
        let (dx, dy) = (tip.0 - from.0, tip.1 - from.1);
        let length = dx.hypot(dy);
        if length < width {
            // It points at the eye, or away from it.
            return self.line((from.0 - width, from.1), (from.0 + width, from.1), 2.0 * width, colour);
        }
        let (ux, uy) = (dx / length, dy / length);
        let head = (4.0 * width).min(0.6 * length);
        let neck = (tip.0 - head * ux, tip.1 - head * uy);
        self.line(from, neck, width, colour);
        let half = 0.45 * head;
        let (left, right) = ((neck.0 - half * uy, neck.1 + half * ux), (neck.0 + half * uy, neck.1 - half * ux));
        self.fill(&[left, tip, right, right], colour, MARK);
    }

    /// Darkens borders between faces and averages the samples of each pixel.
    fn finish(self, width: usize, height: usize, edge: usize) -> Image {
        let is_border = |x: usize, y: usize| {
            let own = self.faces[y * self.width + x];
            if own == MARK {
                return false;
            }
            let reach = edge.div_ceil(2);
            let other = |x: usize, y: usize| self.faces[y * self.width + x] != own;
            (x + reach < self.width && other(x + reach, y)) || (y + reach < self.height && other(x, y + reach))
        };
        let mut image = Image::new(width, height);
        for row in 0..height {
            for column in 0..width {
                let mut sum = [0.0_f32; 3];
                for (x, y) in (0..SAMPLES * SAMPLES).map(|s| (column * SAMPLES + s % SAMPLES, row * SAMPLES + s / SAMPLES)) {
                    let n = y * self.width + x;
                    let light = if edge > 0 && is_border(x, y) { 1.0 - (1.0 - EDGE) * self.opacity[n] } else { 1.0 };
                    sum.iter_mut().zip(self.colours[n]).for_each(|(s, c)| *s += c * light);
                }
                image.set(column, row, sum.map(|s| (s / (SAMPLES * SAMPLES) as f32).round() as u8));
            }
        }
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object_with(voxels: &[([usize; 3], Colour)]) -> Image {
        let dims = Dims::cube(8).unwrap();
        draw_voxels(dims, 160, 160, |v| voxels.iter().find(|(at, _)| dims.coordinates(v) == *at).map(|(_, colour)| *colour))
    }

    fn has(image: &Image, rgb: [u8; 3]) -> bool {
        (0..image.height()).any(|y| (0..image.width()).any(|x| image.pixel(x, y) == rgb))
    }

    #[test]
    fn the_near_voxel_hides_the_far_one() {
        let (red, blue) = (Colour::rgb(100, 0, 0), Colour::rgb(0, 0, 100));
        let top = |c: Colour| c.shaded(LIGHT[0]).rgb;
        // (7, 7, 0) lies behind (0, 0, ·) by seven voxels each; the line of sight falls by 7·√2·tan 30° ≈ 5.7.
        let hidden = object_with(&[([7, 7, 0], red), ([0, 0, 5], blue), ([0, 0, 6], blue), ([0, 0, 4], blue), ([0, 0, 7], blue)]);
        assert!(has(&hidden, top(blue)) && !has(&hidden, top(red)));
        let seen = object_with(&[([7, 7, 7], red), ([0, 0, 0], blue)]);
        assert!(has(&seen, top(blue)) && has(&seen, top(red)));
    }

    #[test]
    fn axes_point_where_the_documentation_says() {
        let view = Projection::fit(Dims::cube(8).unwrap(), 160, 160);
        let (o, x, y, z) = (view.point(0.0, 0.0, 0.0), view.point(1.0, 0.0, 0.0), view.point(0.0, 1.0, 0.0), view.point(0.0, 0.0, 1.0));
        assert!(x.0 > o.0 && x.1 < o.1 && y.0 < o.0 && y.1 < o.1 && z.1 < o.1);
    }

    #[test]
    fn translucent_voxels_let_through_what_is_behind() {
        let ghost = Colour::rgb(0, 0, 100).with_opacity(0.3);
        let both = object_with(&[([4, 4, 4], Colour::rgb(100, 0, 0)), ([4, 4, 5], ghost)]);
        // The solid's top is seen through a side of the one above it.
        let top = Colour::rgb(100, 0, 0).shaded(LIGHT[0]);
        let through = |light: f32| top.mix(Colour { opacity: 1.0, ..ghost.shaded(light) }, 0.3).rgb;
        assert!(has(&both, through(LIGHT[1])) && has(&both, through(LIGHT[2])) && !has(&both, top.rgb));
    }

    #[test]
    fn nothing_drawn_is_paper() {
        assert_eq!(object_with(&[]), Image::new(160, 160));
    }
}
