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

    /// To be called before and after a query: whether what was read came from the file that was mapped. Of one that was rewritten or cut, what
    /// was read before it was noticed must not be used.
    ///
    /// # Errors
    /// [`Damaged::Changed`] if the file is not what it was.
    pub fn check_unchanged(&self) -> Result<(), Damaged> {
        match &self.storage {
            Storage::Mapped { file, .. } if !file.is_unchanged() => Err(Damaged::Changed),
            Storage::Mapped { .. } | Storage::Owned(_) => Ok(()),
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

#[cfg(test)]
mod tests {
    use super::super::first_touch::{PIECE, checksums};
    use super::*;

    #[test]
    fn rows_are_those_of_their_voxels() {
        let values: Vec<f16> = (0..5 * 3).map(|i| f16::from_f32(i as f32)).collect();
        let basis = Basis::new(3, values.clone());
        assert_eq!((basis.rank(), basis.voxels(), basis.values()), (3, 5, &values[..]));
        assert_eq!(basis.row(2), &values[6..9]);
        let mut widened = [0.0; 6];
        basis.widen(3..5, &mut widened);
        assert_eq!(widened, [9.0, 10.0, 11.0, 12.0, 13.0, 14.0]);
        assert_eq!((basis.touch(0..5), basis.check_unchanged()), (Ok(()), Ok(())));
    }

    #[test]
    fn rows_of_a_mapped_file_are_checked_before_they_are_read_and_others_are_not() {
        let rows_a_piece = PIECE / 8;
        let mut bytes: Vec<u8> = (0..3 * PIECE).map(|i| (i * 31 % 59) as u8).collect();
        let checksums = checksums(&bytes);
        bytes[PIECE + 8] ^= 1;
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &bytes).unwrap();
        let map = mapping::map(std::fs::File::open(file.path()).unwrap().into()).unwrap();
        let basis = Basis::mapped(4, Arc::new(map), 0..bytes.len(), FirstTouch::new(checksums));
        assert_eq!(basis.voxels(), 3 * rows_a_piece);
        assert_eq!(basis.touch(0..rows_a_piece), Ok(()));
        assert_eq!(basis.touch(2 * rows_a_piece..3 * rows_a_piece), Ok(()));
        let damaged = Err(Damaged::Checksum { offset: PIECE });
        assert_eq!(basis.touch(rows_a_piece..rows_a_piece + 1), damaged);
        assert_eq!(basis.touch(rows_a_piece - 1..rows_a_piece + 1), damaged);
    }
}
