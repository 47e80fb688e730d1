//! The shared basis W': d × a in half precision, in memory or, of large grids, mapped from the model file.

use super::first_touch::{Damaged, FirstTouch};
use super::mapping::{self, Mapped};
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::ops::Range;
use std::sync::Arc;

/// W', d rows (voxels, C order) of a values; columns are orthonormal up to the rounding of half precision.
#[derive(Clone, Debug)]
pub struct Basis {
    rank: usize,
    storage: Storage,
}

#[derive(Clone, Debug)]
enum Storage {
    Owned(Arc<Vec<f16>>),
    Mapped { file: Arc<Mapped>, bytes: Range<usize>, first_touch: Arc<FirstTouch> },
}

impl Basis {
    /// A basis of d × `rank` values, row after row.
    pub fn new(rank: usize, rows: Vec<f16>) -> Self {
        assert!(rank > 0 && rows.len().is_multiple_of(rank), "whole rows");
        Self { rank, storage: Storage::Owned(Arc::new(rows)) }
    }

    /// A basis inside a mapped file; `bytes` is aligned to two bytes and holds whole rows, little-endian. `first_touch` checks them as
    /// they are read.
    pub(super) fn mapped(rank: usize, file: Arc<Mapped>, bytes: Range<usize>, first_touch: FirstTouch) -> Self {
        Self { rank, storage: Storage::Mapped { file, bytes, first_touch: Arc::new(first_touch) } }
    }

    /// Number of columns, a.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Number of rows, d.
    pub fn voxels(&self) -> usize {
        self.values().len() / self.rank
    }

    /// All values, row after row.
    pub fn values(&self) -> &[f16] {
        match &self.storage {
            Storage::Owned(rows) => rows,
            Storage::Mapped { file, bytes, .. } => bytemuck::cast_slice(&file[bytes.clone()]),
        }
    }

    /// The row of one voxel, a values.
    pub fn row(&self, voxel: usize) -> &[f16] {
        &self.values()[voxel * self.rank..(voxel + 1) * self.rank]
    }

    /// Widens the rows of some voxels into `out` (as many rows of a values).
    pub fn widen(&self, voxels: Range<usize>, out: &mut [f32]) {
        self.values()[voxels.start * self.rank..voxels.end * self.rank].convert_to_f32_slice(out);
    }

    /// To be called before the rows of some voxels are read: checks what of a large file is read for the first time, and keeps the
    /// pages in memory within [`Self::bound`].
    ///
    /// # Errors
    /// [`Damaged`] if they are not what was written.
    pub fn touch(&self, voxels: Range<usize>) -> Result<(), Damaged> {
        match &self.storage {
            Storage::Mapped { file, bytes, first_touch } => {
                let size = self.rank * size_of::<f16>();
                first_touch.touch(file, bytes, voxels.start * size..voxels.end * size)
            }
            Storage::Owned(_) => Ok(()),
        }
    }

    /// Bounds the pages of the file that stay in this process's memory, in bytes; of small files nothing is bounded.
    pub fn bound(&self, bytes: usize) {
        if let Storage::Mapped { file, first_touch, .. } = &self.storage {
            mapping::map_small_pages(file);
            first_touch.bound(bytes);
        }
    }
}
