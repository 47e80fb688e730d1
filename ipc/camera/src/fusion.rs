//! Several carved grids of one object, in one frame, as one: log-odds of being filled, summed and bounded per voxel (Moravec and Elfes,
//! 1985; the constants are OctoMap's, Hornung et al. 2013).

use crate::{EMPTY, FILLED, UNKNOWN};

/// Log-odds of one observation that a voxel is filled (p = 0.7), or empty (p = 0.4).
const HIT: f32 = 0.847;
const MISS: f32 = -0.405;
/// Bounds of the sum, so that later views can still change a voxel.
const BOUNDS: [f32; 2] = [-2.0, 3.5];
/// A voxel within this of 0 is unknown.
const UNDECIDED: f32 = 0.2;

/// The sum of some grids.
#[derive(Clone, Debug, PartialEq)]
pub struct Fusion {
    log_odds: Vec<f32>,
    views: usize,
}

/// A grid that cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FusionError {
    /// Another number of voxels.
    #[error("a grid of {found} voxels cannot be fused with grids of {expected}")]
    Length {
        /// Voxels given.
        found: usize,
        /// Voxels of the others.
        expected: usize,
    },
    /// A byte that is no code.
    #[error("voxel {index} holds {code}: 0 is empty, 1 filled, 255 unknown")]
    Code {
        /// Which voxel.
        index: usize,
        /// Its value.
        code: u8,
    },
}

impl Fusion {
    /// Nothing known yet of `voxels` voxels.
    pub fn new(voxels: usize) -> Self {
        Self { log_odds: vec![0.0; voxels], views: 0 }
    }

    /// Views that were added.
    pub fn views(&self) -> usize {
        self.views
    }

    /// Adds what one view knows; the grid is left as it was on an error.
    pub fn add(&mut self, voxels: &[u8]) -> Result<(), FusionError> {
        if voxels.len() != self.log_odds.len() {
            return Err(FusionError::Length { found: voxels.len(), expected: self.log_odds.len() });
        }
        if let Some(index) = voxels.iter().position(|code| ![EMPTY, FILLED, UNKNOWN].contains(code)) {
            return Err(FusionError::Code { index, code: voxels[index] });
        }
        for (sum, code) in self.log_odds.iter_mut().zip(voxels) {
            let change = match *code {
                FILLED => HIT,
                EMPTY => MISS,
                _ => 0.0,
            };
            *sum = (*sum + change).clamp(BOUNDS[0], BOUNDS[1]);
        }
        self.views += 1;
        Ok(())
    }

    /// Writes what all views together know.
    pub fn write(&self, voxels: &mut [u8]) -> Result<(), FusionError> {
        if voxels.len() != self.log_odds.len() {
            return Err(FusionError::Length { found: voxels.len(), expected: self.log_odds.len() });
        }
        for (code, sum) in voxels.iter_mut().zip(&self.log_odds) {
            *code = match *sum {
                s if s > UNDECIDED => FILLED,
                s if s < -UNDECIDED => EMPTY,
                _ => UNKNOWN,
            };
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_one_view_does_not_see_another_may_and_they_are_weighed() {
        let mut fusion = Fusion::new(6);
        fusion.add(&[FILLED, EMPTY, UNKNOWN, FILLED, FILLED, UNKNOWN]).unwrap();
        fusion.add(&[UNKNOWN, UNKNOWN, EMPTY, EMPTY, EMPTY, UNKNOWN]).unwrap();
        let mut out = [9; 6];
        fusion.write(&mut out).unwrap();
        assert_eq!(out, [FILLED, EMPTY, EMPTY, FILLED, FILLED, UNKNOWN]);
        // Two more views see nothing there.
        fusion.add(&[UNKNOWN, UNKNOWN, UNKNOWN, EMPTY, UNKNOWN, UNKNOWN]).unwrap();
        fusion.add(&[UNKNOWN, UNKNOWN, UNKNOWN, EMPTY, UNKNOWN, UNKNOWN]).unwrap();
        fusion.write(&mut out).unwrap();
        assert_eq!(out, [FILLED, EMPTY, EMPTY, EMPTY, FILLED, UNKNOWN]);
        assert_eq!(fusion.views(), 4);
    }

    #[test]
    fn a_wrong_grid_changes_nothing() {
        let mut fusion = Fusion::new(2);
        assert_eq!(fusion.add(&[0; 3]), Err(FusionError::Length { found: 3, expected: 2 }));
        assert_eq!(fusion.add(&[FILLED, 7]), Err(FusionError::Code { index: 1, code: 7 }));
        assert_eq!(fusion, Fusion::new(2));
    }
}
