//! How W' is read: from tables that are derived from it and kept, or in place, where these would be many times its size.

use super::known::Known;
use super::projection::ColumnSums;
use super::shared_rows::SharedRows;
use crate::grid::{Dims, Observation};
use crate::model::{Basis, Damaged, Footprint};
use fixedbitset::FixedBitSet;
use std::sync::Arc;

/// W' as queries and training read it.
pub enum BasisRows {
    /// Tables: the fastest, for grids on which poses are searched.
    Derived {
        /// Size of the grid.
        dims: Dims,
        /// W'.
        basis: Basis,
        /// Its prefix sums.
        sums: Arc<ColumnSums>,
    },
    /// W' itself, inside its footprint.
    InPlace(Arc<SharedRows>),
}

impl BasisRows {
    /// In place if it is known where W' is not zero, else with tables.
    pub fn new(dims: Dims, basis: &Basis, footprint: Option<&Footprint>) -> Self {
        match footprint {
            Some(footprint) => Self::InPlace(Arc::new(SharedRows::new(dims, basis, footprint))),
            None => Self::Derived { dims, basis: basis.clone(), sums: Arc::new(ColumnSums::new(dims, basis)) },
        }
    }

    /// Size of the grid.
    pub fn dims(&self) -> Dims {
        match self {
            Self::Derived { dims, .. } => *dims,
            Self::InPlace(rows) => rows.dims(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Occupancy, Outside, Placed, View, yaw};
    use crate::model::Searched;
    use crate::perception::evidence::placed::EvidenceScratch;
    use crate::perception::pose::small::{model, perceiver, unseen};
    use crate::perception::{Method, Perceiver, Percept, Query};
    use fixedbitset::FixedBitSet;

    /// The same model, read in place.
    fn in_place() -> Perceiver {
        let (model, dims) = (model(), model().dims());
        let mut support = FixedBitSet::with_capacity(dims.voxels());
        (0..dims.voxels()).filter(|v| model.basis.row(*v).iter().any(|value| value.to_f32() != 0.0)).for_each(|v| support.insert(v));
        assert!(support.count_ones(..) < dims.voxels(), "nothing is tested");
        let footprint = SharedRows::over(dims, model.basis.clone(), support).unwrap().footprint();
        let searched = Searched::KnownPoseOnly { footprint: Some(footprint) };
        Perceiver::new(Arc::new(crate::model::Model { searched, ..(*model).clone() })).unwrap()
    }

    #[test]
    fn tables_and_reading_in_place_give_the_same_answers() {
        let (tables, place) = (perceiver(), in_place());
        let (mut one, mut other) = (Percept::default(), Percept::default());
        let (mut work, mut work_in_place) = (tables.workspace(), place.workspace());
        for method in [Method::Auto, Method::Hull, Method::Evidence, Method::Mean, Method::Paper] {
            for (n, class) in ["chair", "table", "chair"].into_iter().enumerate() {
                let query = Query { method, completion: true, ..Query::default() };
                let seen = View::Top.of(&unseen(class, 5 + n as u64));
                tables.classify(&seen, &query, &mut work, &mut one).unwrap().complete().unwrap();
                place.classify(&seen, &query, &mut work_in_place, &mut other).unwrap().complete().unwrap();
                let close = |a: &[f64], b: &[f64], by: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= by * (1.0 + a.abs()));
                assert!(close(&one.posterior, &other.posterior, 2e-3), "{method:?}: {:?} {:?}", one.posterior, other.posterior);
                assert!(close(&one.scores, &other.scores, 2e-3), "{method:?}: {:?} {:?}", one.scores, other.scores);
                assert!(close(&one.log_evidence, &other.log_evidence, 2e-3), "{method:?}");
                for (a, b) in [(&one.occupancy, &other.occupancy), (&one.deviation, &other.deviation)] {
                    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    assert!(worst < 5e-3, "{method:?}: {worst}");
                }
                // Bytes are the same numbers.
                let mut bytes = [vec![9_u8; one.occupancy.len()], vec![9_u8; one.occupancy.len()]];
                let [p, sd] = &mut bytes;
                place.classify(&seen, &query, &mut work_in_place, &mut other).unwrap().complete_into(p, sd).unwrap();
                for (bytes, values) in bytes.iter().zip([&other.occupancy, &other.deviation]) {
                    assert!(bytes.iter().zip(values).all(|(byte, value)| (f32::from(*byte) - value * 255.0).abs() <= 0.5001), "{method:?}");
                }
            }
        }
    }

    #[test]
    fn evidence_of_a_turned_observation_is_that_of_turning_it_first() {
        let place = in_place();
        let evidence = place.evidence();
        let BasisRows::InPlace(rows) = &evidence.rows else { panic!("read in place") };
        let object: Occupancy = unseen("chair", 3);
        let seen = View::Top.of(&object);
        for angle in [0.0, 0.3, 1.9] {
            let rotation = yaw(angle);
            let (mut whole, mut part) = (EvidenceScratch::new(place.model().dims()), EvidenceScratch::new(place.model().dims()));
            let expected = evidence.of_placed(&seen, &Placed::turned(rotation), Outside::Empty, 0, &mut whole).unwrap();
            let known = whole.frame().known();
            let mut sums = crate::perception::SharedSums::default();
            rows.sum_turned(&seen, &rotation, Outside::Empty, &mut sums).unwrap();
            let last = sums.unknown.len() - 1 - rows.rank();
            for (a, b) in sums.unknown[..last + rows.rank()].iter().zip(&known.sums.unknown) {
                assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "{angle}: {a} {b}");
            }
            for (a, b) in sums.filled[..rows.rank()].iter().zip(&known.sums.filled) {
                assert!((a - b).abs() < 1e-3 * (1.0 + b.abs()), "{angle}: {a} {b}");
            }
            // Relative to the background nothing outside the footprint matters.
            let found = evidence.of_turned(&seen, &rotation, Outside::Empty, 0, &mut part).unwrap();
            let (expected, found) = (expected.log_ratio, found.log_ratio);
            assert!((expected - found).abs() < 0.02 * (1.0 + expected.abs()), "{angle}: {expected} {found}");
        }
    }
}
