//! The training driver: one fit on all shapes, and fits on folds from whose held-out objects the calibration is learned.

use super::camera_calibration::LeftOut;
use super::camera_density::camera_densities;
use super::camera_views::{ClassShapes, Views};
use super::error::TrainError;
use super::fit::{Data, Fit};
use super::held_out::{HeldOut, calibrate};
use super::hull_density::HullMoments;
use super::options::TrainOptions;
use super::progress::Step;
use super::shapes::{ShapeSet, by_class};
use super::shrinkage::{centre, shrunk_covariance};
use super::view_density::view_densities;
use crate::grid::{Occupancy, Shrinking};
use crate::model::{ClassInfo, ClassModel, FORMAT_VERSION, HullDensity, Metadata, Model, Searched, TrainingSettings, levels_of};
use crate::perception::evidence::placed::EvidenceModel;
use faer::Mat;
use rayon::prelude::*;
use std::sync::Arc;

/// Learns a model. The same shapes and options give the same model, whatever the number of threads.
///
/// Of grids that are too large to be searched, the same shapes on smaller grids are learned as well, in which poses are searched.
///
/// # Errors
/// [`TrainError`].
pub fn train(shapes: &ShapeSet, options: &TrainOptions, progress: &(dyn Fn(Step) + Sync)) -> Result<Model, TrainError> {
    let (dims, classes) = by_class(shapes)?;
    let smaller = if options.poses { levels_of(dims) } else { Vec::new() };
    let mut levels = Vec::new();
    for to in &smaller {
        let shrinking = Shrinking::new(dims, *to);
        let shrunk: Vec<Vec<Occupancy>> =
            classes.iter().map(|class| class.par_iter().map(|shape| shrinking.occupancy(shape)).collect()).collect();
        if let Some(s) = shrunk.iter().position(|class| class.iter().all(|shape| shape.count() == 0)) {
            return Err(TrainError::Vanished { class: shapes.classes[s].clone(), dims: *to });
        }
        let longest_side = (options.longest_side as f64 / shrinking.factor()).round() as usize;
        let data = Data::new(*to, shrunk.iter().map(|class| class.iter().collect()).collect());
        levels.push(learn(&data, &shapes.classes, &TrainOptions { longest_side, ..options.clone() }, progress)?);
    }
    // Cameras are searched where poses are.
    let elevations = if smaller.is_empty() && options.poses { options.camera_elevations_deg.clone() } else { Vec::new() };
    let mut data = Data::new(dims, classes);
    if let Some(lengths) = shapes.lengths_m.as_ref().filter(|lengths| lengths.len() == shapes.shapes.len()) {
        let mut of_class = vec![Vec::new(); shapes.classes.len()];
        shapes.shapes.iter().zip(lengths).for_each(|(shape, lengths)| of_class[shape.class].push(*lengths));
        data.lengths_m = Some(of_class);
    }
    if let Some(fine) = shapes.fine.as_ref().filter(|fine| fine.len() == shapes.shapes.len()) {
        let mut of_class = vec![Vec::new(); shapes.classes.len()];
        shapes.shapes.iter().zip(fine).for_each(|(shape, fine)| of_class[shape.class].push(fine));
        data.fine = Some(of_class);
    }
    let options = TrainOptions { camera_elevations_deg: elevations, ..options.clone() };
    let model = learn(&data, &shapes.classes, &options, progress)?;
    let searched = match model.searched {
        Searched::KnownPoseOnly { footprint: Some(footprint) } if !levels.is_empty() => Searched::OnLevels { footprint, levels },
        searched => searched,
    };
    Ok(Model { searched, ..model })
}

/// A model of one grid.
fn learn(data: &Data<'_>, names: &[String], options: &TrainOptions, progress: &(dyn Fn(Step) + Sync)) -> Result<Model, TrainError> {
    if options.views.is_empty() {
        return Err(TrainError::Nothing);
    }
    let sides = <[usize; 3]>::from(data.dims);
    let side = sides.into_iter().fold(0, usize::max);
    let folds = data.folds(options);
    let cameras = !options.camera_elevations_deg.is_empty();
    let total = folds.len() + 3 + usize::from(cameras);
    let step = |name, done| progress(Step { name, side, pass: None, done, total });
    let within = |name, done| move |pass| progress(Step { name, side, pass: Some(pass), done, total });

    let mut held_out = Vec::new();
    // What was learned without the first fold also scores what cameras see of it.
    let mut first: Option<EvidenceModel> = None;
    for (f, fold) in folds.iter().enumerate() {
        const NAME: &str = "fitting without a fold, scoring it";
        step(NAME, f);
        let (measured, fit) = HeldOut::measure(data, fold, options, &within(NAME, f))?;
        held_out.push(measured);
        if f == 0 && cameras {
            first = Some(fit);
        }
    }
    step("calibrating on held-out objects", folds.len());
    let mut calibration = calibrate(&held_out, data.classes.len())?;
    drop(held_out);

    const FITTING: &str = "fitting on all shapes";
    step(FITTING, folds.len() + 1);
    let everything: Vec<Vec<usize>> = data.classes.iter().map(|c| (0..c.len()).collect()).collect();
    let mut fit = Fit::new(data, &everything, options, &within(FITTING, folds.len() + 1))?;
    let hulls: Vec<HullMoments> = options
        .views
        .iter()
        .map(|view| {
            let projected = fit.project_hulls(data, &everything, *view);
            HullMoments::new(&projected.iter().map(Mat::as_ref).collect::<Vec<_>>())
        })
        .collect();
    let mut turned = None;
    if fit.footprint.is_none() && options.poses {
        step("learning views from all sides", folds.len() + 2);
        turned = Some(view_densities(&data.classes, options.seed)?);
    }
    let mut camera = None;
    if let Some(first) = first {
        step("learning what cameras see", folds.len() + 3);
        let elevations: Vec<f64> = options.camera_elevations_deg.iter().map(|e| e.to_radians()).collect();
        let mut held = vec![Vec::new(); data.classes.len()];
        folds[0].held.iter().for_each(|(class, shape)| held[*class].push(*shape));
        let evidence_blend = calibration.evidence.clone();
        let left_out = LeftOut {
            held: &held,
            evidence: EvidenceModel { noise_variance: first.noise_variance * calibration.noise_inflation, ..first },
            evidence_blend: &evidence_blend,
            longest_side: options.longest_side,
        };
        let lengths = |class: usize| data.lengths_m.as_ref().map(|lengths| &lengths[class][..]);
        let fine = |class: usize| data.fine.as_ref().map(|fine| &fine[class][..]);
        let shapes: Vec<ClassShapes<'_>> =
            data.classes.iter().enumerate().map(|(s, objects)| ClassShapes { objects, lengths_m: lengths(s), fine: fine(s) }).collect();
        let views = Views { elevations: &elevations, sensing: options.sensing, lying: options.lying, seed: options.seed };
        let learned = camera_densities(&shapes, &left_out, &views)?;
        calibration.camera = Some(learned.calibration);
        camera = Some(learned.densities);
    }
    let (mut infos, mut classes) = (Vec::new(), Vec::new());
    for (s, class) in std::mem::take(&mut fit.classes).into_iter().enumerate() {
        let (_, centred) = centre(class.projected.as_ref());
        let shrunk = shrunk_covariance(&centred);
        let a = centred.ncols();
        infos.push(ClassInfo {
            name: names[s].clone(),
            shapes: data.classes[s].len(),
            basis_size: class.model.variances.len(),
            explained: class.explained,
            noise_variance: class.noise_variance,
            shrinkage: shrunk.intensity,
        });
        let hull = |moments: &HullMoments| {
            let (mean, covariance) = moments.density(s, calibration.prior_strength);
            HullDensity { mean, covariance }
        };
        classes.push(ClassModel {
            covariance: (0..a * a).map(|v| shrunk.covariance[((v / a).max(v % a), (v / a).min(v % a))] as f32).collect(),
            hulls: hulls.iter().map(hull).collect(),
            ..class.model
        });
    }
    // Upright objects of one kind need no word, so that older programs read such a model.
    let components = camera.as_ref().map_or(Vec::new(), |camera| camera.components.clone());
    let plain = components.iter().all(|component| component.is_upright() && component.size.is_none());
    let metadata = Metadata {
        camera_components: if plain { Vec::new() } else { components },
        format_version: FORMAT_VERSION,
        beo_version: env!("CARGO_PKG_VERSION").into(),
        licence: options.licence.clone(),
        dims: data.dims,
        classes: infos,
        noise_variance: fit.noise,
        calibration,
        settings: TrainingSettings {
            splits: options.splits.clone(),
            views: options.views.clone(),
            camera_elevations_deg: options.camera_elevations_deg.clone(),
            poses: options.poses,
            variance_share: options.variance_share,
            basis_range: options.basis_range,
            longest_side: options.longest_side,
            seed: options.seed,
            folds: options.folds,
        },
    };
    let Fit { basis, footprint, .. } = fit;
    let searched = match turned {
        Some(views) => Searched::Here { views: Arc::new(views), cameras: camera.map(Arc::new) },
        None => Searched::KnownPoseOnly { footprint },
    };
    Ok(Model { id: 0, metadata, basis, classes, searched })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture;
    use crate::grid::{Dims, View};
    use crate::learning::Shape;
    use crate::perception::{PerceiveError, Perceiver, Percept, PoseSearch, Query};

    /// On a grid on which poses are searched, and on one that is too large for that.
    #[test]
    fn a_model_without_poses_is_saved_completes_as_one_with_them_and_refuses_to_search() {
        let folder = tempfile::tempdir().unwrap();
        for side in [16, 66] {
            let dims = Dims::cube(side).unwrap();
            let object = |seed| furniture::make("chair", dims, seed).unwrap();
            let shapes = (0..6).map(|n| Shape { object: object(n), class: 0, file: n.to_string() }).collect();
            let shapes = ShapeSet { classes: vec!["chair".into()], shapes, ..ShapeSet::default() };
            let mut answers = Vec::new();
            for poses in [true, false] {
                let model = train(&shapes, &TrainOptions { poses, ..TrainOptions::default() }, &|_| {}).unwrap();
                assert_eq!((model.levels().is_empty(), model.view_densities().is_some()), (side == 16 || !poses, side == 16 && poses));
                // What was saved is loaded as the same kind of model.
                let file = folder.path().join("a.safetensors");
                crate::model::save(&model, &file).unwrap();
                let loaded = crate::model::load(&file).unwrap();
                assert_eq!(std::mem::discriminant(&loaded.searched), std::mem::discriminant(&model.searched));
                assert_eq!(crate::model::outline(&file).unwrap().levels.len(), model.levels().len());
                let perceiver = Perceiver::new(Arc::new(loaded)).unwrap();
                let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
                let seen = View::Top.of(&object(9));
                let mut query = Query { completion: true, ..Query::default() };
                perceiver.classify(&seen, &query, &mut work, &mut percept).unwrap().complete().unwrap();
                answers.push(percept.occupancy.clone());
                query.pose = PoseSearch::Yaw { span: 1.0 };
                let searched = perceiver.classify(&seen, &query, &mut work, &mut percept).map(|_| ());
                assert_eq!(matches!(searched, Err(PerceiveError::KnownPoseOnly)), !poses, "{searched:?}");
            }
            assert_eq!(answers[0], answers[1], "{side}");
        }
    }
}
