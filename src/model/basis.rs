//! The shared basis W': d × a in half precision, in memory or mapped from the model file.

use half::f16;
use half::slice::HalfFloatSliceExt;
use memmap2::Mmap;
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
    Owned(Arc<[f16]>),
    Mapped { file: Arc<Mmap>, bytes: Range<usize> },
}

impl Basis {
    /// A basis of d × `rank` values, row after row.
    pub fn new(rank: usize, rows: Vec<f16>) -> Self {
        assert!(rank > 0 && rows.len().is_multiple_of(rank), "whole rows");
        Self { rank, storage: Storage::Owned(rows.into()) }
    }

    /// A basis inside a mapped file; `bytes` is aligned to two bytes and holds whole rows, little-endian.
    pub(super) fn mapped(rank: usize, file: Arc<Mmap>, bytes: Range<usize>) -> Self {
        Self { rank, storage: Storage::Mapped { file, bytes } }
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
            Storage::Mapped { file, bytes } => super::file::half_slice(&file[bytes.clone()]),
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
}
