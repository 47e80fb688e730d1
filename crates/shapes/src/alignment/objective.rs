//! The objective that congealing lowers: the entropy of the stack of shapes, Σ over cells of the binary entropy of the mean occupancy, in bits
//! (Learned-Miller 2006, section 2: the sum of the pixelwise entropies of the stack).
//!
//! Occupancies are whole numbers of 255ths, so that sums are exact whatever their order, and shapes can be taken out of the stack and
//! put back without a trace.

use super::ShapeSimilarity;
use super::solid::{Canvas, Level, Solid};

/// Occupancy of a full cell.
const FULL: usize = 255;

/// Entropy in bits of a cell that is filled with probability p.
pub fn binary_entropy(p: f64) -> f64 {
    let part = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
    part(p) + part(1.0 - p)
}

/// The sum of some placed shapes, cell by cell.
#[derive(Clone)]
pub(super) struct Stack {
    pub level: Level,
    pub canvas: Canvas,
    counts: Vec<u32>,
    /// Entropy by the sum of occupancies.
    table: std::sync::Arc<Vec<f32>>,
    /// The greatest entry of the table.
    full: u32,
}

impl Stack {
    /// An empty stack for up to `shapes` shapes.
    pub fn new(level: Level, resolution: usize, shapes: usize) -> Self {
        let canvas = Canvas::new(level.cells(resolution));
        let full = FULL * shapes;
        let table = (0..=full).map(|sum| binary_entropy(sum as f64 / full as f64) as f32).collect();
        Self { level, canvas, counts: vec![0; canvas.cells()], table: std::sync::Arc::new(table), full: full as u32 }
    }

    /// The stack of all these shapes; `None` if one of them leaves the canvas.
    pub fn of(level: Level, resolution: usize, solids: &[Solid], placements: &[ShapeSimilarity]) -> Option<Self> {
        let mut stack = Self::new(level, resolution, solids.len());
        solids.iter().zip(placements).all(|(solid, placement)| stack.add(solid, placement)).then_some(stack)
    }

    /// Shapes of a full stack.
    pub fn shapes(&self) -> usize {
        self.full as usize / FULL
    }

    /// Adds a shape, unless it leaves the canvas.
    pub fn add(&mut self, solid: &Solid, placement: &ShapeSimilarity) -> bool {
        let counts = &mut self.counts;
        solid.for_each_cell(self.level, &self.canvas, placement, |cell, value| counts[cell] += u32::from(value))
    }

    /// Takes a shape out that had been added with the same placement.
    pub fn remove(&mut self, solid: &Solid, placement: &ShapeSimilarity) {
        let counts = &mut self.counts;
        solid.for_each_cell(self.level, &self.canvas, placement, |cell, value| counts[cell] -= u32::from(value));
    }

    /// Mean filled cells of a shape.
    pub fn volume(&self) -> f64 {
        self.counts.iter().map(|count| f64::from(*count)).sum::<f64>() / f64::from(self.full)
    }

    /// Bits over all cells.
    pub fn entropy(&self) -> f64 {
        self.counts.iter().filter(|count| **count > 0).map(|count| f64::from(self.table[*count as usize])).sum()
    }

    /// How much the entropy would rise by adding a shape; infinite if it leaves the canvas.
    pub fn rise(&self, solid: &Solid, placement: &ShapeSimilarity) -> f64 {
        let mut rise = 0.0;
        let is_inside = solid.for_each_cell(self.level, &self.canvas, placement, |cell, value| {
            let count = self.counts[cell] as usize;
            rise += f64::from(self.table[count + usize::from(value)] - self.table[count]);
        });
        if is_inside { rise } else { f64::INFINITY }
    }

    /// Mean occupancy of every cell of the unit cube, 0 to 1, in C order.
    pub fn mean_in_unit_cube(&self, cells: usize) -> Vec<f32> {
        let first = (self.canvas.side - cells) / 2;
        let row = |i: usize, j: usize| {
            let start = self.canvas.index(i + first, j + first, first);
            self.counts[start..start + cells].iter().map(|count| *count as f32 / self.full as f32)
        };
        (0..cells).flat_map(|i| (0..cells).flat_map(move |j| row(i, j))).collect()
    }
}
