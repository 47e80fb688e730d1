//! The model file: one safetensors file, checked before use. models/README.md documents every tensor.

use super::camera_density::CELLS;
use super::first_touch::{FirstTouch, PIECE, checksums};
use super::opened::Opened;
use super::{
    Basis, CameraDensities, ClassModel, Component, DIRECTIONS, FORMAT_VERSION, Footprint, HullDensity, MOST_COMPONENTS, Metadata, Model,
    OFFSETS, Searched, ViewDensities, YAWS, levels_of,
};
use super::{LONGEST_CLASS_NAME, MOST_CLASSES};
use crate::grid::{Dims, Pooling};
use crate::whole_file::WholeFile;
use half::f16;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// From so many bytes on, the basis of a grid that is too large to be searched is mapped, so that only what queries read takes memory.
pub const MAPPED_FROM: u64 = 64 << 20;
/// The key of our description in the header of the file.
pub(super) const KEY: &str = "beo";

#[cfg(target_endian = "big")]
compile_error!("model files are little-endian and are mapped as they are");

/// A model file cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's own message.
        source: std::io::Error,
    },
    /// The file is not a model, or is damaged.
    #[error("{}: not a usable model: {reason}; train it again or fetch a fresh copy", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The fault.
        reason: String,
    },
    /// There is no room for the file.
    #[error("{}: a model of about {needed} bytes does not fit there, {free} are free: free some, or write it elsewhere", path.display())]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// Bytes it would have.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },
    /// The file was written in another format.
    #[error("{}: model format {found}, this program reads format {FORMAT_VERSION}: train the model again with this version", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u64,
    },
}

/// The description in the header, with what is needed to detect damage.
#[derive(Serialize, Deserialize)]
pub(super) struct Header {
    pub metadata: Metadata,
    /// CRC-32 of each tensor's bytes.
    pub checksums: BTreeMap<String, u32>,
    /// CRC-32 of `metadata`, `checksums` and the table of tensors.
    pub checksum: u32,
}

/// Names, shapes and lengths, written out: damage to the table of tensors changes this text.
pub(super) type Table = BTreeMap<String, (String, Vec<usize>, usize)>;

pub(super) fn header_checksum(metadata: &Metadata, checksums: &BTreeMap<String, u32>, table: &Table) -> u32 {
    let text = serde_json::to_string(&(metadata, checksums, table)).expect("plain data");
    crc32fast::hash(text.as_bytes())
}

/// Length of a packed lower triangle of `size` rows.
fn packed(size: usize) -> usize {
    size * (size + 1) / 2
}

/// The lower triangles, row after row, of symmetric matrices of `size` × `size` values.
fn pack(matrices: &[f32], size: usize) -> Vec<f32> {
    let rows = matrices.chunks_exact(size).enumerate();
    rows.flat_map(|(i, row)| row[..=i % size].iter().copied()).collect()
}

/// The symmetric matrices of such lower triangles.
fn unpack(triangles: &[f32], size: usize) -> Vec<f32> {
    let matrices = triangles.chunks_exact(packed(size));
    let entry = |(i, j): (usize, usize)| packed(i.max(j)) + i.min(j);
    matrices.flat_map(|t| (0..size * size).map(move |v| t[entry((v / size, v % size))])).collect()
}

/// Writes a model. The file appears under its name only when it is complete.
pub fn save(model: &Model, path: &Path) -> Result<(), ModelError> {
    let io = |source| ModelError::Io { path: path.to_owned(), source };
    let mut file = place(path)?;
    if let Some(temporary) = file.temporary() {
        with_tensors(model, |tensors, header| safetensors::serialize_to_file(tensors, Some(header), temporary))
            .map_err(|error| io(std::io::Error::other(error)))?;
    }
    // The writer has put a file of its own there, for one user only.
    file.take_up().and_then(|()| file.keep()).map_err(io)
}

/// Begins the file of a model, which is no pipe and no device: it is mapped.
fn place(path: &Path) -> Result<WholeFile, ModelError> {
    let io = |source| ModelError::Io { path: path.to_owned(), source };
    let file = WholeFile::create(path).map_err(io)?;
    match file.temporary() {
        Some(_) => Ok(file),
        None => Err(io(std::io::Error::other("not a regular file"))),
    }
}

/// A level of a model: the bytes of a whole model file.
fn level_bytes(level: &Model) -> Vec<u8> {
    with_tensors(level, |tensors, header| safetensors::serialize(tensors, Some(header)).expect("names and shapes are sound"))
}

pub(super) fn level_name(dims: Dims) -> String {
    format!("level_{}", <[usize; 3]>::from(dims).into_iter().fold(0, usize::max))
}

/// Calls `write` with a model's tensors and the description for the header.
fn with_tensors<R>(model: &Model, write: impl FnOnce(Vec<(String, TensorView<'_>)>, HashMap<String, String>) -> R) -> R {
    let (classes, rank) = (model.classes.len(), model.rank());
    let stack = |part: fn(&ClassModel) -> &[f32]| -> Vec<f32> { model.classes.iter().flat_map(|c| part(c).iter().copied()).collect() };
    let mut floats: Vec<(String, Vec<usize>, Vec<f32>)> = vec![
        ("class_mean".into(), vec![classes, rank], stack(|c| &c.mean)),
        ("class_covariance".into(), vec![classes, packed(rank)], pack(&stack(|c| &c.covariance), rank)),
    ];
    let directions = stack(|c| &c.directions);
    floats.push(("class_directions".into(), vec![directions.len() / rank, rank], directions));
    for (v, view) in model.views().iter().enumerate() {
        let stack = |part: fn(&HullDensity) -> &[f32]| -> Vec<f32> {
            model.classes.iter().flat_map(|c| part(&c.hulls[v]).iter().copied()).collect()
        };
        floats.push((format!("hull_{}_mean", view.name()), vec![classes, rank], stack(|h| &h.mean)));
        floats.push((format!("hull_{}_covariance", view.name()), vec![classes, packed(rank)], pack(&stack(|h| &h.covariance), rank)));
    }
    let variances: Vec<f64> = model.classes.iter().flat_map(|c| c.variances.iter().copied()).collect();

    let mut tensors: Vec<(String, Dtype, Vec<usize>, &[u8])> = vec![
        ("basis".into(), Dtype::F16, vec![model.basis.voxels(), rank], bytemuck::cast_slice(model.basis.values())),
        ("class_variances".into(), Dtype::F64, vec![variances.len()], bytemuck::cast_slice(&variances)),
    ];
    if let Some(views) = model.view_densities() {
        let p = views.size;
        let halves: [(&str, Vec<usize>, &[f16]); 4] = [
            ("view_basis", vec![views.basis.len() / p, p], &views.basis),
            ("view_mean", vec![DIRECTIONS, classes, p], &views.means),
            ("view_whitening", vec![DIRECTIONS, classes, packed(p)], &views.whitening),
            ("view_regression", vec![DIRECTIONS, classes, 3, p], &views.regression),
        ];
        for (name, shape, values) in halves {
            tensors.push((name.into(), Dtype::F16, shape, bytemuck::cast_slice(values)));
        }
    }
    let (bits, pieces);
    if let Some(footprint) = model.footprint() {
        bits = footprint.bytes();
        pieces = checksums(bytemuck::cast_slice(model.basis.values()));
        tensors.push(("basis_footprint".into(), Dtype::U8, vec![bits.len()], &bits));
        tensors.push(("basis_gram".into(), Dtype::F64, vec![footprint.gram.len()], bytemuck::cast_slice(&footprint.gram)));
        tensors.push(("basis_pieces".into(), Dtype::U32, vec![pieces.len()], bytemuck::cast_slice(&pieces)));
    }
    let levels: Vec<(String, Vec<u8>)> = model.levels().iter().map(|level| (level_name(level.dims()), level_bytes(level))).collect();
    for (name, bytes) in &levels {
        tensors.push((name.clone(), Dtype::U8, vec![bytes.len()], bytes));
    }
    if let Some(cameras) = model.camera_densities() {
        let (e, components, p) = (cameras.elevations.len(), cameras.components.len(), cameras.size);
        let halves: [(&str, Vec<usize>, &[f16]); 4] = [
            ("camera_basis", vec![cameras.basis.len() / p, p], &cameras.basis),
            ("camera_mean", vec![e, YAWS, components, p], &cameras.means),
            ("camera_whitening", vec![e, YAWS, components, packed(p)], &cameras.whitening),
            ("camera_regression", vec![e, YAWS, components, OFFSETS, p], &cameras.regression),
        ];
        for (name, shape, values) in halves {
            tensors.push((name.into(), Dtype::F16, shape, bytemuck::cast_slice(values)));
        }
        for (name, values) in [("camera_offset", &cameras.offsets), ("camera_deviation", &cameras.deviations)] {
            tensors.push((name.into(), Dtype::F32, vec![e, YAWS, components, OFFSETS], bytemuck::cast_slice(values)));
        }
    }
    for (name, shape, values) in &floats {
        tensors.push((name.clone(), Dtype::F32, shape.clone(), bytemuck::cast_slice(values)));
    }
    let checksums: BTreeMap<String, u32> = tensors.iter().map(|(name, _, _, bytes)| (name.clone(), crc32fast::hash(bytes))).collect();
    let table: Table =
        tensors.iter().map(|(name, dtype, shape, bytes)| (name.clone(), (dtype.to_string(), shape.clone(), bytes.len()))).collect();
    let checksum = header_checksum(&model.metadata, &checksums, &table);
    let header = Header { metadata: model.metadata.clone(), checksums, checksum };
    let header = HashMap::from([(KEY.to_string(), serde_json::to_string(&header).expect("plain data"))]);

    let tensors = tensors.into_iter().map(|(name, dtype, shape, bytes)| {
        (name, TensorView::new(dtype, shape, bytes).expect("the shapes were computed from the lengths"))
    });
    write(tensors.collect(), header)
}

/// Outcome of a full check of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VerifyReport {
    /// Tensors checked.
    pub tensors: usize,
    /// Their bytes.
    pub bytes: usize,
}

/// Checks the header and every tensor of a model file, whatever its size.
pub fn verify(path: &Path) -> Result<VerifyReport, ModelError> {
    let file = Opened::open(path)?;
    let mut bytes = 0;
    for name in file.header.checksums.keys() {
        bytes += file.verify(name)?;
    }
    Ok(VerifyReport { tensors: file.header.checksums.len(), bytes })
}

/// Content of the header of a model file.
#[derive(Debug, Clone)]
pub struct Outline {
    /// Description of the model and of its training.
    pub metadata: Metadata,
    /// Number of columns of W', a.
    pub rank: usize,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Bytes of W'.
    pub basis_bytes: u64,
    /// The models on smaller grids.
    pub levels: Vec<Outline>,
}

impl Outline {
    /// Bytes of memory that [`load`] takes at a time: what it reads, and twice the covariances as full matrices.
    pub fn bytes(&self) -> u64 {
        let matrices = self.metadata.classes.len() as u64 * (1 + self.metadata.settings.views.len() as u64);
        matrices.saturating_mul(self.rank as u64 * self.rank as u64).saturating_mul(2 * 4).saturating_add(self.file_bytes)
    }
}

impl Outline {
    /// Whether [`load`] maps the basis: only what queries read of it takes memory.
    pub fn is_mapped(&self) -> bool {
        !levels_of(self.metadata.dims).is_empty() && self.basis_bytes >= MAPPED_FROM
    }
}

/// Reads and checks the header of a model file, and nothing else.
pub fn outline(path: &Path) -> Result<Outline, ModelError> {
    outline_of(Opened::open(path)?)
}

fn outline_of(file: Opened) -> Result<Outline, ModelError> {
    let rank = file.rank()?;
    let level = |dims| outline_of(file.level(dims)?);
    let levels = levels_in(&file.header.metadata).into_iter().map(level).collect::<Result<_, ModelError>>()?;
    let basis_bytes = (file.header.metadata.dims.voxels() * rank * size_of::<f16>()) as u64;
    Ok(Outline { rank, file_bytes: file.len(), basis_bytes, levels, metadata: file.header.metadata })
}

/// Fails unless a model of `bytes` can be written to `path`: a training that cannot keep what it learned should not begin.
pub fn check_place(path: &Path, bytes: u64) -> Result<(), ModelError> {
    let io = |source| ModelError::Io { path: path.to_owned(), source };
    let file = place(path)?;
    let space = rustix::fs::fstatvfs(file.file()).map_err(|error| io(error.into()))?;
    let free = space.f_bavail.saturating_mul(space.f_frsize);
    if free < bytes {
        return Err(ModelError::NoRoom { path: path.to_owned(), needed: bytes, free });
    }
    Ok(())
}

/// Reads a model file and checks its header, sizes and checksums. The basis of a large grid, from [`MAPPED_FROM`] bytes on, is mapped
/// instead, and checked piece by piece as it is read.
pub fn load(path: &Path) -> Result<Model, ModelError> {
    read(&Opened::open(path)?)
}

fn read(file: &Opened) -> Result<Model, ModelError> {
    // First the sizes that the description names: they are bounded there.
    let rank = file.rank()?;
    let metadata = &file.header.metadata;
    let m = metadata.classes.len();
    let total: usize = metadata.classes.iter().map(|c| c.basis_size).sum();
    let searched = searched(file, metadata, rank)?;
    let is_large = !matches!(searched, Searched::Here { .. } | Searched::KnownPoseOnly { footprint: None });
    let basis = match is_large && file.bytes_of("basis")? >= MAPPED_FROM {
        true => {
            let pieces = file.bytes_of("basis")?.div_ceil(PIECE as u64) as usize;
            let checksums = file.words("basis_pieces", &[pieces])?;
            let (map, bytes) = file.mapped("basis")?;
            Basis::mapped(rank, map, bytes, FirstTouch::new(checksums))
        }
        false => Basis::new(rank, file.halves("basis", &[metadata.dims.voxels(), rank])?),
    };

    let mean = file.floats("class_mean", &[m, rank])?;
    let covariance = symmetric(file, "class_covariance", m, rank)?;
    let directions = file.floats("class_directions", &[total, rank])?;
    let variances = file.doubles("class_variances", &[total])?;
    if !variances.iter().all(|v| *v > 0.0 && v.is_finite()) {
        return Err(file.invalid("a variance of a class is not a positive number"));
    }
    let mut hulls = Vec::new();
    for view in &metadata.settings.views {
        hulls.push((
            file.floats(&format!("hull_{}_mean", view.name()), &[m, rank])?,
            symmetric(file, &format!("hull_{}_covariance", view.name()), m, rank)?,
        ));
    }
    let slice = |values: &[f32], s: usize, size: usize| values[s * size..(s + 1) * size].to_vec();
    let mut first = 0;
    let classes = metadata
        .classes
        .iter()
        .enumerate()
        .map(|(s, info)| {
            let rows = first..first + info.basis_size;
            first = rows.end;
            ClassModel {
                mean: slice(&mean, s, rank),
                covariance: slice(&covariance, s, rank * rank),
                directions: directions[rows.start * rank..rows.end * rank].to_vec(),
                variances: variances[rows].to_vec(),
                hulls: hulls
                    .iter()
                    .map(|(mean, covariance)| HullDensity { mean: slice(mean, s, rank), covariance: slice(covariance, s, rank * rank) })
                    .collect(),
            }
        })
        .collect();
    let id = u64::from(file.header.checksum) << 32 | u64::from(file.header.checksums.get("basis").copied().unwrap_or(0));
    Ok(Model { id, metadata: file.header.metadata.clone(), basis, classes, searched })
}

/// The smaller grids whose models a file holds.
fn levels_in(metadata: &Metadata) -> Vec<Dims> {
    if metadata.settings.poses { levels_of(metadata.dims) } else { Vec::new() }
}

/// Checks conditions that every file written by `save` satisfies, and a hand-made one may not.
pub(super) fn check_metadata(metadata: &Metadata) -> Result<(), String> {
    let m = metadata.classes.len();
    let calibration = &metadata.calibration;
    let blends = [&calibration.auto, &calibration.hull, &calibration.evidence, &calibration.mean];
    if blends.iter().any(|blend| blend.offsets.len() != m) {
        return Err("its calibration is for another number of classes".into());
    }
    // What a method does not compute has no weight in its blend.
    let [auto, hull, evidence, mean] = blends;
    let foreign =
        [auto.distance, hull.evidence, hull.distance, evidence.hull, evidence.distance, mean.hull, mean.evidence].iter().any(|w| *w != 0.0);
    if foreign {
        return Err("its calibration weighs scores that the method does not compute".into());
    }
    let elevations = &metadata.settings.camera_elevations_deg;
    let ascending = elevations.windows(2).all(|pair| pair[0] < pair[1]);
    if !ascending || elevations.len() > 32 || !elevations.iter().all(|e| (-90.0..=90.0).contains(e)) {
        return Err("its cameras' elevations are not at most 32 ascending angles from -90 to 90".into());
    }
    if !metadata.settings.poses && !elevations.is_empty() {
        return Err("it was learned for known poses alone, but names elevations of cameras".into());
    }
    match (&calibration.camera, elevations.is_empty()) {
        (None, true) => (),
        (Some(camera), false)
            if camera.pose_weight > 0.0
                && std::iter::once(&camera.blend)
                    .chain(&camera.together)
                    .all(|blend| blend.offsets.len() == m && blend.distance == 0.0)
                && camera.spread.is_none_or(|spread| spread.place.iter().chain(&spread.extent).all(|v| *v > 0.0 && *v < 1e3)) => {}
        _ => return Err("its calibration does not fit its cameras".into()),
    }
    check_components(metadata)?;
    if m > MOST_CLASSES {
        return Err(format!("it has {m} classes, more than the {MOST_CLASSES} that a percept can name"));
    }
    if let Some(class) = metadata.classes.iter().find(|c| c.name.len() > LONGEST_CLASS_NAME || c.basis_size > MOST_COMPONENTS) {
        return Err(format!("class `{}` has too long a name or more than {MOST_COMPONENTS} components", class.name));
    }
    if metadata.settings.views.is_empty() {
        return Err("it was trained for no view".into());
    }
    let positive = [metadata.noise_variance, calibration.noise_inflation, calibration.degrees_of_freedom];
    if !positive.iter().all(|v| *v > 0.0 && v.is_finite()) {
        return Err("its noise variance, noise inflation or degrees of freedom is not a positive number".into());
    }
    Ok(())
}

/// Components are of classes that there are, each class has one, and their numbers make sense.
fn check_components(metadata: &Metadata) -> Result<(), String> {
    let (components, m) = (&metadata.camera_components, metadata.classes.len());
    if components.is_empty() {
        return Ok(());
    }
    let sound = |component: &Component| {
        let norm: f64 = component.resting_rotation.iter().map(|v| v * v).sum();
        let sized = component.size.is_none_or(|size| size.log_density(size.mean.map(f64::exp), [0.0; 3]).is_finite());
        component.class < m && component.probability > 0.0 && component.probability <= 1.0 && (norm - 1.0).abs() < 1e-6 && sized
    };
    if !components.iter().all(sound) || components.len() > MOST_COMPONENTS {
        return Err("a component of what its cameras see is not sound".into());
    }
    match (0..m).find(|class| !components.iter().any(|component| component.class == *class)) {
        Some(class) => Err(format!("class `{}` has no component of what cameras see", metadata.classes[class].name)),
        None => Ok(()),
    }
}

/// The models on smaller grids.
fn levels(file: &Opened, metadata: &Metadata) -> Result<Vec<Model>, ModelError> {
    let level = |dims| {
        let name = level_name(dims);
        file.verify(&name)?;
        let level = read(&file.level(dims)?)?;
        let names = |m: &Metadata| m.classes.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        if names(&level.metadata) != names(metadata) {
            return Err(file.invalid(format!("tensor `{name}` is a model of other shapes")));
        }
        Ok(level)
    };
    levels_in(metadata).into_iter().map(level).collect()
}

/// With what the model is searched: its settings say whether at all, and its dims on which grids.
fn searched(file: &Opened, metadata: &Metadata, rank: usize) -> Result<Searched, ModelError> {
    let is_large = !levels_of(metadata.dims).is_empty();
    match (metadata.settings.poses, is_large) {
        (true, false) => {
            let cameras = camera_densities(file, metadata)?.map(Arc::new);
            Ok(Searched::Here { views: Arc::new(view_densities(file, metadata)?), cameras })
        }
        (true, true) => {
            let (footprint, levels) = (footprint(file, metadata, rank)?, levels(file, metadata)?);
            if levels.iter().any(|level| !matches!(level.searched, Searched::Here { .. })) {
                return Err(file.invalid("one of its smaller grids is not searched itself"));
            }
            Ok(Searched::OnLevels { footprint, levels })
        }
        (false, true) => Ok(Searched::KnownPoseOnly { footprint: Some(footprint(file, metadata, rank)?) }),
        (false, false) => Ok(Searched::KnownPoseOnly { footprint: None }),
    }
}

fn footprint(file: &Opened, metadata: &Metadata, rank: usize) -> Result<Footprint, ModelError> {
    let voxels = metadata.dims.voxels();
    let bytes = file.bytes("basis_footprint", &[Footprint::length(voxels)])?;
    let gram = file.doubles("basis_gram", &[packed(rank + 1)])?;
    Ok(Footprint { voxels: Footprint::bits(voxels, &bytes), gram })
}

/// Symmetric matrices that are stored as lower triangles, `count` of `size` × `size`.
fn symmetric(file: &Opened, name: &str, count: usize, size: usize) -> Result<Vec<f32>, ModelError> {
    Ok(unpack(&file.floats(name, &[count, packed(size)])?, size))
}

fn view_densities(file: &Opened, metadata: &Metadata) -> Result<ViewDensities, ModelError> {
    let (m, cells) = (metadata.classes.len(), Pooling::new(metadata.dims).count());
    let size = file.columns("view_basis")?;
    if size == 0 || size > cells {
        return Err(file.invalid(format!("tensor `view_basis` has {size} columns where 1 to {cells} were expected")));
    }
    let triangle = packed(size);
    let densities = ViewDensities {
        size,
        basis: file.halves("view_basis", &[cells, size])?,
        means: file.halves("view_mean", &[DIRECTIONS, m, size])?,
        whitening: file.halves("view_whitening", &[DIRECTIONS, m, triangle])?,
        regression: file.halves("view_regression", &[DIRECTIONS, m, 3, size])?,
    };
    check_factors(file, "view_whitening", &densities.whitening, size)?;
    Ok(densities)
}

fn camera_densities(file: &Opened, metadata: &Metadata) -> Result<Option<CameraDensities>, ModelError> {
    let elevations = &metadata.settings.camera_elevations_deg;
    if elevations.is_empty() {
        return Ok(None);
    }
    let size = file.columns("camera_basis")?;
    if size == 0 || size > CELLS {
        return Err(file.invalid(format!("tensor `camera_basis` has {size} columns where 1 to {CELLS} were expected")));
    }
    let components = match metadata.camera_components.is_empty() {
        true => (0..metadata.classes.len()).map(Component::upright).collect(),
        false => metadata.camera_components.clone(),
    };
    let at = |rest: &[usize]| [&[elevations.len(), YAWS, components.len()], rest].concat();
    let densities = CameraDensities {
        components: components.clone(),
        elevations: elevations.iter().map(|e| e.to_radians()).collect(),
        size,
        basis: file.halves("camera_basis", &[CELLS, size])?,
        means: file.halves("camera_mean", &at(&[size]))?,
        whitening: file.halves("camera_whitening", &at(&[packed(size)]))?,
        offsets: file.floats("camera_offset", &at(&[OFFSETS]))?,
        regression: file.halves("camera_regression", &at(&[OFFSETS, size]))?,
        deviations: file.floats("camera_deviation", &at(&[OFFSETS]))?,
    };
    check_factors(file, "camera_whitening", &densities.whitening, size)?;
    if !densities.offsets.iter().all(|v| v.abs() < 1e3) || !densities.deviations.iter().all(|v| *v > 0.0 && *v < 1e3) {
        return Err(file.invalid("tensor `camera_offset` or `camera_deviation` holds a value that is out of range"));
    }
    Ok(Some(densities))
}

/// Packed triangles have a positive diagonal.
fn check_factors(file: &Opened, name: &str, factors: &[f16], size: usize) -> Result<(), ModelError> {
    let positive = |factor: &[f16]| (0..size).all(|i| factor[packed(i + 1) - 1] > f16::ZERO);
    if factors.chunks_exact(packed(size)).all(positive) {
        return Ok(());
    }
    Err(file.invalid(format!("tensor `{name}` has a diagonal that is not positive")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symmetric_matrices_survive_packing() {
        let matrices = [1.0, 2.0, 4.0, 2.0, 3.0, 5.0, 4.0, 5.0, 6.0, 7.0, 8.0, 0.5, 8.0, 9.0, 0.25, 0.5, 0.25, 10.0];
        let triangles = pack(&matrices, 3);
        assert_eq!(triangles, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 0.5, 0.25, 10.0]);
        assert_eq!(unpack(&triangles, 3), matrices);
    }
}
