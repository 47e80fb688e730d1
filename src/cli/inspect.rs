//! `beo inspect`: what a model holds, in words and pictures.

use super::failure::{Failure, cannot_write};
use beo_core::model::{Blend, ClassModel, Metadata, Model, Outline, ViewDensities, load, outline, verify};
use beo_core::perception::{derived_bytes, workspace_bytes};
use beo_picture::{Chart, Image, draw_probability, draw_weights, sheet};
use clap::Args;
use std::path::{Path, PathBuf};

/// Modes drawn per class, and leading variances listed.
const MODES: usize = 4;
/// Standard deviations that the pictures go along a mode, to either side.
const REACH: f32 = 2.0;
/// Side of one picture of voxels in pixels.
const SIDE: usize = 240;
/// Lines that one chart of spectra holds.
const LINES: usize = 10;

/// Show what a model holds
#[derive(Args)]
pub struct Inspect {
    /// Model file
    model: PathBuf,
    /// Draw class means, leading modes and spectra into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Check every tensor against its checksum, however large
    #[arg(long)]
    verify: bool,
}

impl Inspect {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if let Some(folder) = &self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let model = load(&self.model)?;
        say!("{}", self.model.display());
        say!("{}\n{}\n{}", summary(&model, &outline(&self.model)?), classes(&model), calibration(&model.metadata).trim_end());
        if self.verify {
            let report = verify(&self.model)?;
            say!("\n{} tensors, {:.1} MB, all as written", report.tensors, report.bytes as f64 / 1e6);
        }
        if let Some(folder) = &self.png {
            draw(&model, folder)?;
        }
        Ok(())
    }
}

fn summary(model: &Model, outline: &Outline) -> String {
    let file_bytes = outline.file_bytes as usize;
    let (meta, set) = (&model.metadata, &model.metadata.settings);
    let (d, a) = (model.dims().voxels(), model.rank());
    let mb = |bytes: usize| format!("{:.1} MB", bytes as f64 / 1e6);
    let size = |class: &ClassModel| {
        let hulls: usize = class.hulls.iter().map(|h| h.mean.len() + h.covariance.len()).sum();
        4 * (class.mean.len() + class.covariance.len() + class.directions.len() + hulls) + 8 * class.variances.len()
    };
    let parts: usize = model.classes.iter().map(size).sum();
    // Of the symmetric matrices the file holds one half.
    let halves: usize = model.classes.iter().map(|c| 1 + c.hulls.len()).sum::<usize>() * 4 * (a * (a - 1) / 2);
    let halved = parts - halves;
    let derived = derived_bytes(outline) + workspace_bytes(outline);
    let of_turned = |d: &ViewDensities| 2 * (d.basis.len() + d.means.len() + d.whitening.len() + d.regression.len());
    let turned = model.view_densities().map_or(0, of_turned);
    let smaller: u64 = outline.levels.iter().map(|level| level.file_bytes).sum();
    let shapes: usize = meta.classes.iter().map(|c| c.shapes).sum();
    let views: Vec<&str> = model.views().iter().map(|v| v.name()).collect();
    let splits = if set.splits.is_empty() { "no splits".into() } else { format!("splits {}", set.splits.join(", ")) };
    let licence = if meta.licence.is_empty() { "not stated" } else { &meta.licence };
    let memory = match model.footprint() {
        None => format!("about {} when answering queries", mb(2 * d * a + parts + turned + derived)),
        Some(footprint) => {
            let share = footprint.voxels.count_ones(..) as f64 / d as f64;
            format!(
                "about {} when answering queries, and of the basis what is read: at most {} ({:.1} % of the grid; `--memory` bounds it)",
                mb(parts + derived + smaller as usize),
                mb((2.0 * share * (d * a) as f64) as usize),
                100.0 * share
            )
        }
    };
    let levels: Vec<String> = model.levels().iter().map(|level| level.dims().to_string()).collect();
    let lines = [
        ("model", format!("{:016x}, format {}, by beo {}", model.id, meta.format_version, meta.beo_version)),
        ("grid", format!("{}, longest side of meshes {} voxels", meta.dims, set.longest_side)),
        ("basis", format!("rank {a} over {d} voxels, noise variance {:.5}", meta.noise_variance)),
        (
            "file",
            match model.footprint() {
                None => {
                    format!("{}: {} basis (mapped), {} classes, {} turned objects", mb(file_bytes), mb(2 * d * a), mb(halved), mb(turned))
                }
                Some(_) => format!(
                    "{}: {} basis (mapped), {} classes, {} smaller grids",
                    mb(file_bytes),
                    mb(2 * d * a),
                    mb(halved),
                    mb(smaller as usize)
                ),
            },
        ),
        ("memory", memory),
        ("training", format!("{shapes} shapes in {} classes, {splits}, views {}", meta.classes.len(), views.join(", "))),
        (
            "settings",
            format!(
                "{:.0} % of the variance in {} to {} components, {} folds, seed {}",
                100.0 * set.variance_share,
                set.basis_range[0],
                set.basis_range[1],
                set.folds,
                set.seed
            ),
        ),
        ("licence", licence.to_owned()),
    ];
    let levels = (!levels.is_empty()).then(|| ("poses", format!("searched on {}, refined on the larger", levels.join(" and "))));
    lines.iter().chain(&levels).map(|(name, text)| format!("{name:<9} {text}\n")).collect()
}

fn classes(model: &Model) -> String {
    let mut text = format!(
        "{:<16} {:>7} {:>6} {:>10} {:>10} {:>10}   {}\n",
        "class", "shapes", "basis", "explained", "noise", "shrinkage", "leading variances … least"
    );
    for (info, class) in model.metadata.classes.iter().zip(&model.classes) {
        let leading: String = class.variances.iter().take(MODES).map(|v| format!("{v:>7.1}")).collect();
        text += &format!(
            "{:<16} {:>7} {:>6} {:>9.1}% {:>10.5} {:>10.3}  {leading} … {:.2}\n",
            info.name,
            info.shapes,
            info.basis_size,
            100.0 * info.explained,
            info.noise_variance,
            info.shrinkage,
            class.variances.last().copied().unwrap_or(0.0)
        );
    }
    text
}

fn calibration(meta: &Metadata) -> String {
    let c = &meta.calibration;
    let blend = |name: &str, blend: &Blend| {
        let weights =
            [(blend.hull, "hull density"), (blend.evidence, "evidence"), (blend.distance, "negative squared distance to the mean")];
        let terms: Vec<String> = weights.iter().filter(|(w, _)| *w != 0.0).map(|(w, what)| format!("{w:.3e} × {what}")).collect();
        let named = || blend.offsets.iter().zip(&meta.classes).map(|(offset, class)| (*offset, class.name.as_str()));
        let least = named().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""));
        let most = named().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""));
        let offsets = match (least.0, most.0) {
            (0.0, 0.0) => "no offsets".to_owned(),
            _ => format!("offsets {:+.2} ({}) to {:+.2} ({})", least.0, least.1, most.0, most.1),
        };
        format!("  {name:<9} {}; {offsets}\n", if terms.is_empty() { "nothing".to_owned() } else { terms.join(" + ") })
    };
    let k = &c.completion;
    let mut text =
        format!("calibration on {} held-out objects: accuracy {:.1} %, log loss {:.3} nats\n", c.objects, 100.0 * c.accuracy, c.log_loss);
    text += "  log posterior of a class, by method:\n";
    for (name, weights) in [("auto", &c.auto), ("hull", &c.hull), ("evidence", &c.evidence), ("mean", &c.mean)] {
        text += &blend(name, weights);
    }
    text += &format!("  hull density with {:.0} degrees of freedom, prior of {:.0} objects\n", c.degrees_of_freedom, c.prior_strength);
    text += &format!("  evidence with noise variance × {:.1}\n", c.noise_inflation);
    text += &format!(
        "  logit of a voxel: {:+.2} {:+.2} × posterior mean {:+.2} × class mean {:+.2} × log depth {:+.2} if first below\n",
        k.constant, k.mean, k.class_mean, k.log_depth, k.surface
    );
    text
}

/// Draws everything into an existing folder.
fn draw(model: &Model, folder: &Path) -> Result<(), Failure> {
    let save = |image: Image, name: &str| image.save(&folder.join(name)).map_err(Failure::from);
    let means: Vec<Vec<f32>> = model.classes.iter().map(|class| voxels(model, &class.mean)).collect();
    save(means_sheet(model, &means), "means.png")?;
    save(spectra(model), "spectra.png")?;
    for (s, mean) in means.iter().enumerate() {
        save(modes_sheet(model, s, mean), &format!("modes_{}.png", file_name(&model.metadata.classes[s].name)))?;
    }
    Ok(())
}

/// A vector in coordinates of the shared basis as voxels, W' v.
fn voxels(model: &Model, vector: &[f32]) -> Vec<f32> {
    let mut row = vec![0.0; model.rank()];
    let mut voxel = |v: usize| {
        model.basis.widen(v..v + 1, &mut row);
        row.iter().zip(vector).map(|(w, x)| w * x).sum()
    };
    (0..model.dims().voxels()).map(&mut voxel).collect()
}

/// A class name as part of a file name: a model file may hold any text.
fn file_name(class: &str) -> String {
    class.chars().map(|c| if c.is_alphanumeric() || c == '_' || c == '-' { c } else { '_' }).collect()
}

fn means_sheet(model: &Model, means: &[Vec<f32>]) -> Image {
    let cells: Vec<_> = model
        .metadata
        .classes
        .iter()
        .zip(means)
        .map(|(info, mean)| (draw_probability(model.dims(), mean, SIDE), format!("{}, {} shapes", info.name, info.shapes)))
        .collect();
    let rows: Vec<_> = cells.chunks(5).map(<[_]>::to_vec).collect();
    sheet(&rows, "Class means: the most probable voxels, as many as an object fills on average; paler is rarer")
}

/// One row per leading mode: its weights, and the mean moved along it to either side.
fn modes_sheet(model: &Model, s: usize, mean: &[f32]) -> Image {
    let (dims, rank, class, name) = (model.dims(), model.rank(), &model.classes[s], &model.metadata.classes[s].name);
    let total: f64 = class.variances.iter().sum();
    let middle = draw_probability(dims, mean, SIDE);
    let rows: Vec<_> = class
        .variances
        .iter()
        .take(MODES)
        .enumerate()
        .map(|(h, variance)| {
            let mode = voxels(model, &class.directions[h * rank..(h + 1) * rank]);
            let deviation = variance.max(0.0).sqrt();
            let moved = |by: f32| {
                let moved: Vec<f32> = mean.iter().zip(&mode).map(|(m, w)| (m + by * deviation as f32 * w).clamp(0.0, 1.0)).collect();
                draw_probability(dims, &moved, SIDE)
            };
            let share = 100.0 * variance / total.max(f64::MIN_POSITIVE);
            vec![
                (draw_weights(dims, &mode, SIDE), format!("mode {}: sd {deviation:.1}, {share:.0} % of the basis", h + 1)),
                (moved(-REACH), format!("mean - {REACH} sd")),
                (middle.clone(), "mean".to_owned()),
                (moved(REACH), format!("mean + {REACH} sd")),
            ]
        })
        .collect();
    sheet(&rows, &format!("{name}: leading modes (orange: filled at +, blue: filled at -)"))
}

/// Variance by component, one line per class, ten classes to a chart.
fn spectra(model: &Model) -> Image {
    let series: Vec<_> = model
        .metadata
        .classes
        .iter()
        .zip(&model.classes)
        .map(|(info, class)| (info.name.clone(), class.variances.iter().enumerate().map(|(h, v)| ((h + 1) as f64, *v)).collect()))
        .collect::<Vec<(String, Vec<(f64, f64)>)>>();
    let chart = Chart { width: 1000, height: 520, y_log: true, ..Chart::new("Spectra", "component", "variance, logarithmic") };
    sheet(&series.chunks(LINES).map(|some| vec![(chart.lines(some), String::new())]).collect::<Vec<_>>(), "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_name_cannot_leave_the_folder() {
        assert_eq!(file_name("night_stand"), "night_stand");
        assert_eq!(file_name("../a b/ü.png"), "___a_b_ü_png");
    }
}
