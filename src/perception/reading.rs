//! How W' is read: from tables that are derived from it and kept, or in place, where these would be many times its size.

use super::known::Known;
use super::{ClassSubspace, ColumnSums, SharedRows};
use crate::grid::{Dims, Observation};
use crate::model::{Basis, ClassModel, Damaged, Footprint};
use fixedbitset::FixedBitSet;
use std::sync::Arc;

/// W' as queries and training read it.
pub enum Reading {
    /// Tables: the fastest, for grids on which poses are searched.
    Derived {
        /// Size of the grid.
        dims: Dims,
        /// W'.
        basis: Basis,
        /// Its prefix sums.
        sums: ColumnSums,
    },
    /// W' itself, inside its footprint.
    InPlace(Arc<SharedRows>),
}

impl Reading {
    /// In place if it is known where W' is not zero, else with tables.
    pub fn new(dims: Dims, basis: &Basis, footprint: Option<&Footprint>) -> Self {
        match footprint {
            Some(footprint) => Self::InPlace(Arc::new(SharedRows::new(dims, basis, footprint))),
            None => Self::Derived { dims, basis: basis.clone(), sums: ColumnSums::new(dims, basis) },
        }
    }

    /// A class, ready for queries that are taken apart by [`Self::take_apart`].
    pub fn class(&self, class: &ClassModel) -> ClassSubspace {
        match self {
            Self::Derived { dims, basis, .. } => ClassSubspace::new(*dims, basis, class),
            Self::InPlace(rows) => ClassSubspace::shared(rows, class),
        }
    }

    /// Takes an observation apart, and sums over it what is read in place.
    ///
    /// # Errors
    /// [`Damaged`] if a part of the model file that is read for the first time is not what was written.
    pub fn take_apart(&self, observation: &Observation, known: &mut Known) -> Result<(), Damaged> {
        known.read(observation);
        match self {
            Self::Derived { .. } => Ok(()),
            Self::InPlace(rows) => rows.sum(known),
        }
    }

    /// W'ᵀh of the hull of an observation that was taken apart, into `out` (a values).
    pub fn project_hull(&self, known: &Known, out: &mut [f32]) {
        match self {
            Self::Derived { sums, .. } => sums.project(&known.hull, out),
            Self::InPlace(rows) => rows.hull(known, out),
        }
    }

    /// W'ᵀx of the binary vector with these bits, into `out` (a values).
    pub fn project(&self, bits: &FixedBitSet, out: &mut [f32]) {
        match self {
            Self::Derived { sums, .. } => sums.project(bits, out),
            Self::InPlace(rows) => rows.project(bits, out),
        }
    }
}
