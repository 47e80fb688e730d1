//! The model file: one safetensors file, checked before use. models/README.md documents every tensor.

use super::camera_density::{CELLS, MEASURES};
use super::container::{self, Dtype, Tensor};
use super::error::ModelError;
use super::first_touch::{FirstTouch, PIECE, checksums};
use super::header::{Header, KEY, Table, header_checksum, level_name};
use super::opened::Opened;
use super::{
    Basis, CameraCalibration, CameraDensities, ClassModel, Component, DIRECTIONS, Footprint, Forest, HullDensity, Metadata, Model, OFFSETS,
    Searched, ViewDensities, YAWS, levels_of,
};
use crate::grid::{Dims, Pooling};
use crate::whole_file::WholeFile;
use half::f16;
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

/// From so many bytes on, the basis of a grid that is too large to be searched is mapped, so that only what queries read takes memory.
pub const MAPPED_FROM: u64 = 64 << 20;
#[cfg(target_endian = "big")]
compile_error!("model files are little-endian and are mapped as they are");

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
    let mut out = BufWriter::with_capacity(1 << 20, place(path)?);
    write(model, &mut out).map_err(io)?;
    out.into_inner().map_err(std::io::IntoInnerError::into_error).and_then(WholeFile::keep).map_err(io)
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
    let mut bytes = Vec::new();
    write(level, &mut bytes).expect("there is memory");
    bytes
}

/// Writes a model's tensors, and its description into the header.
fn write(model: &Model, out: &mut dyn Write) -> std::io::Result<()> {
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
        if let Some(forest) = &cameras.forest {
            let nodes = forest.asks.len();
            tensors.push(("forest_root".into(), Dtype::U32, vec![forest.roots.len()], bytemuck::cast_slice(&forest.roots)));
            tensors.push(("forest_input".into(), Dtype::U8, vec![nodes], &forest.asks));
            tensors.push(("forest_threshold".into(), Dtype::F32, vec![nodes], bytemuck::cast_slice(&forest.thresholds)));
            tensors.push(("forest_next".into(), Dtype::U32, vec![nodes], bytemuck::cast_slice(&forest.next)));
            let leaves = forest.scores.len() / forest.outcomes;
            tensors.push(("forest_score".into(), Dtype::F16, vec![leaves, forest.outcomes], bytemuck::cast_slice(&forest.scores)));
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
    let header = serde_json::to_string(&header).expect("plain data");
    let tensors = tensors.into_iter().map(|(name, dtype, shape, data)| (name, Tensor { dtype, shape, data })).collect();
    container::write(tensors, [KEY, &header], out)
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

/// Reads a model file and checks its header, sizes and checksums. The basis of a large grid, from 64 MiB on, is mapped
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
        forest: forest(file, metadata)?,
    };
    check_factors(file, "camera_whitening", &densities.whitening, size)?;
    if !densities.offsets.iter().all(|v| v.abs() < 1e3) || !densities.deviations.iter().all(|v| *v > 0.0 && *v < 1e3) {
        return Err(file.invalid("tensor `camera_offset` or `camera_deviation` holds a value that is out of range"));
    }
    Ok(Some(densities))
}

/// The forest that names what cameras see, if the calibration weighs one.
fn forest(file: &Opened, metadata: &Metadata) -> Result<Option<Forest>, ModelError> {
    if !metadata.calibration.camera.as_ref().is_some_and(CameraCalibration::has_forest) {
        return Ok(None);
    }
    let outcomes = metadata.classes.len() + 1;
    let length = |name: &str, bytes: u64| Ok::<_, ModelError>((file.bytes_of(name)? / bytes) as usize);
    let (trees, nodes, leaves) = (length("forest_root", 4)?, length("forest_input", 1)?, length("forest_score", 2 * outcomes as u64)?);
    let forest = Forest {
        inputs: MEASURES,
        outcomes,
        roots: file.words("forest_root", &[trees])?,
        asks: file.bytes("forest_input", &[nodes])?,
        thresholds: file.floats("forest_threshold", &[nodes])?,
        next: file.words("forest_next", &[nodes])?,
        scores: file.halves("forest_score", &[leaves, outcomes])?,
    };
    match forest.fault() {
        Some(fault) => Err(file.invalid(format!("its forest {fault}"))),
        None => Ok(Some(forest)),
    }
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
    use super::super::test_models::{known_pose_only, searched_here, searched_on_levels};
    use super::*;
    use safetensors::SafeTensors;

    #[test]
    fn symmetric_matrices_survive_packing() {
        let matrices = [1.0, 2.0, 4.0, 2.0, 3.0, 5.0, 4.0, 5.0, 6.0, 7.0, 8.0, 0.5, 8.0, 9.0, 0.25, 0.5, 0.25, 10.0];
        let triangles = pack(&matrices, 3);
        assert_eq!(triangles, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 0.5, 0.25, 10.0]);
        assert_eq!(unpack(&triangles, 3), matrices);
    }

    fn small() -> Dims {
        Dims::new(8, 9, 10).unwrap()
    }

    fn large() -> Dims {
        Dims::new(66, 8, 9).unwrap()
    }

    #[track_caller]
    fn assert_same(one: &Model, other: &Model) {
        assert_eq!(one.metadata, other.metadata);
        assert_eq!((one.basis.rank(), one.basis.values()), (other.basis.rank(), other.basis.values()));
        assert_eq!(one.classes, other.classes);
        assert_eq!(one.view_densities(), other.view_densities());
        assert_eq!(one.camera_densities(), other.camera_densities());
        assert_eq!(one.footprint(), other.footprint());
        assert_eq!(one.levels().len(), other.levels().len());
        one.levels().iter().zip(other.levels()).for_each(|(one, other)| assert_same(one, other));
    }

    #[test]
    fn every_kind_of_model_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let models = [searched_here(small()), searched_on_levels(large()), known_pose_only(small()), known_pose_only(large())];
        let mut ids = Vec::new();
        for model in models {
            save(&model, &path).unwrap();
            let loaded = load(&path).unwrap();
            assert_same(&model, &loaded);
            assert_eq!(std::mem::discriminant(&model.searched), std::mem::discriminant(&loaded.searched));
            ids.push(loaded.id);

            let (bytes, outline) = (std::fs::read(&path).unwrap(), outline(&path).unwrap());
            // Two classes with one view: four matrices of 3 × 3 single-precision values, twice.
            assert_eq!((outline.file_bytes, outline.bytes()), (bytes.len() as u64, bytes.len() as u64 + 4 * 9 * 4 * 2));
            assert_eq!((outline.rank, outline.basis_bytes), (3, 2 * 3 * model.dims().voxels() as u64));
            assert_eq!(outline.levels.iter().map(|level| level.metadata.dims).collect::<Vec<_>>(), levels_in(&model.metadata));
            assert!(!outline.is_mapped());
            assert_eq!(outline.metadata, model.metadata);

            let tensors = SafeTensors::deserialize(&bytes).unwrap();
            let of_tensors = tensors.iter().map(|(_, tensor)| tensor.data().len()).sum();
            assert_eq!(verify(&path).unwrap(), VerifyReport { tensors: tensors.len(), bytes: of_tensors });
        }
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), 4, "each file has an identity");
    }

    /// A bit of every tensor in turn, and the file's last bytes.
    #[test]
    fn a_damaged_or_cut_tensor_is_named_by_loading_and_by_verifying() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        save(&searched_here(small()), &path).unwrap();
        let good = std::fs::read(&path).unwrap();
        let (header_bytes, info) = SafeTensors::read_metadata(&good).unwrap();
        let mut count = 0;
        for (name, tensor) in info.tensors() {
            let mut damaged = good.clone();
            damaged[8 + header_bytes + tensor.data_offsets.0] ^= 4;
            std::fs::write(&path, damaged).unwrap();
            for message in [load(&path).unwrap_err().to_string(), verify(&path).unwrap_err().to_string()] {
                assert!(message.contains(&format!("`{name}` does not match its checksum")), "{message}");
            }
            count += 1;
        }
        assert!(count > 10);
        std::fs::write(&path, &good[..good.len() - 5]).unwrap();
        let total = good.len() - 8 - header_bytes;
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains(&format!("its tensors have {total} bytes, of which {} are there", total - 5)), "{message}");
        // A header that reaches to the very end is one without tensors; one that reaches beyond is none.
        for (claimed, is_beyond) in [(good.len() as u64 - 8, false), (good.len() as u64 - 7, true)] {
            std::fs::write(&path, [&claimed.to_le_bytes(), &good[8..]].concat()).unwrap();
            let message = load(&path).unwrap_err().to_string();
            assert_eq!(message.contains("says that it has"), is_beyond, "{message}");
        }
    }

    #[test]
    fn a_basis_is_mapped_from_its_limit_on_if_its_grid_is_too_large_to_be_searched() {
        let outline = |dims, basis_bytes| {
            let metadata = Metadata { dims, ..searched_here(small()).metadata };
            Outline { metadata, rank: 3, file_bytes: 0, basis_bytes, levels: Vec::new() }.is_mapped()
        };
        let cases = [(large(), MAPPED_FROM - 1), (large(), MAPPED_FROM), (small(), MAPPED_FROM)].map(|(dims, bytes)| outline(dims, bytes));
        assert_eq!(cases, [false, true, false]);
        assert_eq!(MAPPED_FROM, 64 * 1024 * 1024);
    }

    /// Writes a model that `change` has spoiled, with the checksums of what it is then.
    #[track_caller]
    fn refused(model: &Model, change: impl FnOnce(&mut Model), parts: &[&str]) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let mut model = model.clone();
        change(&mut model);
        save(&model, &path).unwrap();
        let message = load(&path).unwrap_err().to_string();
        parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is not in: {message}"));
    }

    fn views(model: &mut Model) -> &mut ViewDensities {
        let Searched::Here { views, .. } = &mut model.searched else { panic!("searched here") };
        Arc::make_mut(views)
    }

    fn cameras(model: &mut Model) -> &mut CameraDensities {
        let Searched::Here { cameras: Some(cameras), .. } = &mut model.searched else { panic!("searched before cameras") };
        Arc::make_mut(cameras)
    }

    #[test]
    fn values_out_of_their_range_are_refused_by_the_name_of_their_tensor() {
        let model = searched_here(small());
        for variance in [0.0, -1.0] {
            refused(&model, |m| m.classes[1].variances[1] = variance, &["variance of a class"]);
        }
        refused(&model, |m| m.classes[1].variances[1] = f64::INFINITY, &["class_variances", "not a number", "3"]);
        refused(&model, |m| m.classes[0].hulls[0].covariance[0] = f32::NAN, &["hull_top_covariance", "the first at 0"]);
        // The last factor's last diagonal.
        refused(&model, |m| *views(m).whitening.last_mut().unwrap() = f16::ZERO, &["view_whitening", "diagonal"]);
        refused(&model, |m| views(m).whitening[0] = -f16::ONE, &["view_whitening", "diagonal"]);
        refused(&model, |m| *cameras(m).whitening.last_mut().unwrap() = -f16::ONE, &["camera_whitening", "diagonal"]);
        refused(&model, |m| cameras(m).offsets[3] = 1000.0, &["camera_offset", "out of range"]);
        refused(&model, |m| cameras(m).offsets[3] = -1000.0, &["camera_offset", "out of range"]);
        for deviation in [0.0, -1.0, 1000.0] {
            refused(&model, |m| cameras(m).deviations[5] = deviation, &["camera_deviation", "out of range"]);
        }
        refused(&model, |m| cameras(m).forest.as_mut().unwrap().next[0] = 0, &["its forest", "not there"]);
        // What is not on the diagonal may have any sign.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let mut signed = model.clone();
        views(&mut signed).whitening[1] = -f16::ONE;
        cameras(&mut signed).whitening[1] = -f16::ONE;
        cameras(&mut signed).offsets[3] = -999.0;
        save(&signed, &path).unwrap();
        assert_same(&signed, &load(&path).unwrap());
    }

    /// Writes a model with one tensor of another shape and other bytes, and the checksums of what it is then.
    fn with_tensor(model: &Model, name: &str, shape: &[usize], data: &[u8], path: &Path) {
        let mut bytes = Vec::new();
        write(model, &mut bytes).unwrap();
        let (_, info) = SafeTensors::read_metadata(&bytes).unwrap();
        let mut header: Header = serde_json::from_str(&info.metadata().as_ref().unwrap()[KEY]).unwrap();
        header.checksums.insert(name.to_owned(), crc32fast::hash(data));
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let tensor = |(of, view): (&str, safetensors::tensor::TensorView<'_>)| {
            let dtype = serde_json::from_value(serde_json::json!(view.dtype().to_string())).unwrap();
            let (shape, start) = if of == name { (shape.to_vec(), None) } else { (view.shape().to_vec(), Some(view.data().to_vec())) };
            (of.to_owned(), dtype, shape, start.unwrap_or_else(|| data.to_vec()))
        };
        let tensors: Vec<(String, Dtype, Vec<usize>, Vec<u8>)> = file.iter().map(tensor).collect();
        let entry = |(name, dtype, shape, data): &(String, Dtype, Vec<usize>, Vec<u8>)| {
            (name.clone(), (dtype.to_string(), shape.clone(), data.len()))
        };
        let table: Table = tensors.iter().map(entry).collect();
        header.checksum = header_checksum(&header.metadata, &header.checksums, &table);
        let tensors =
            tensors.iter().map(|(name, dtype, shape, data)| (name.clone(), Tensor { dtype: *dtype, shape: shape.clone(), data })).collect();
        let mut out = Vec::new();
        container::write(tensors, [KEY, &serde_json::to_string(&header).unwrap()], &mut out).unwrap();
        std::fs::write(path, out).unwrap();
    }

    #[test]
    fn tensors_of_another_shape_are_refused_with_both() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let (model, cells) = (searched_here(small()), small().voxels());
        let refused = |name: &str, shape: &[usize], bytes: usize, parts: &[&str]| {
            with_tensor(&model, name, shape, &vec![0; bytes], &path);
            let message = load(&path).unwrap_err().to_string();
            parts.iter().for_each(|part| assert!(message.contains(part), "`{part}` is not in: {message}"));
        };
        let expected = format!("1 to {cells} were expected");
        refused("view_basis", &[2, cells + 1], 4 * (cells + 1), &[&format!("{} columns", cells + 1), &expected]);
        refused("view_basis", &[cells, 0], 0, &["`view_basis` has 0 columns", &expected]);
        refused("view_basis", &[cells, cells], 2 * cells * cells, &["view_mean"]);
        let expected = format!("1 to {CELLS} were expected");
        refused("camera_basis", &[1, CELLS + 1], 2 * (CELLS + 1), &[&format!("{} columns", CELLS + 1), &expected]);
        refused("camera_basis", &[CELLS, 0], 0, &["`camera_basis` has 0 columns", &expected]);
        refused("camera_basis", &[1, CELLS], 2 * CELLS, &["camera_basis", &format!("[{CELLS}, {CELLS}]")]);
        refused("basis", &[cells, 0], 0, &["no class or no basis"]);
        refused("basis", &[cells - 1, 3], 6 * (cells - 1), &["`basis`", &format!("[{cells}, 3]")]);
        refused("class_directions", &[5, 3], 60, &["class_directions", "[5, 3]", "[4, 3]"]);
        refused("forest_threshold", &[5], 20, &["forest_threshold", "[5]", "[4]"]);
    }

    #[test]
    fn levels_are_models_of_the_same_shapes_that_are_searched_themselves() {
        let model = searched_on_levels(large());
        let level = |m: &mut Model, change: &dyn Fn(&mut Model)| {
            let Searched::OnLevels { levels, .. } = &mut m.searched else { panic!("searched on levels") };
            change(&mut levels[1]);
        };
        refused(&model, |m| level(m, &|level| level.metadata.classes[0].name = "c".into()), &["level_64", "other shapes"]);
        let unsearched = |m: &mut Model| level(m, &|level| *level = known_pose_only(level.dims()));
        refused(&model, unsearched, &["smaller grids is not searched itself"]);
        let named = |m: &mut Model| level(m, &|level| level.classes[0].variances[0] = -1.0);
        refused(&model, named, &["variance of a class"]);
    }

    #[test]
    fn a_model_of_upright_objects_needs_no_components() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let mut model = searched_here(small());
        model.metadata.camera_components = Vec::new();
        cameras(&mut model).components = (0..2).map(Component::upright).collect();
        save(&model, &path).unwrap();
        assert_same(&model, &load(&path).unwrap());
        // Nor a forest.
        let camera = model.metadata.calibration.camera.as_mut().unwrap();
        (camera.with_forest, camera.none, camera.together) = (None, None, None);
        cameras(&mut model).forest = None;
        save(&model, &path).unwrap();
        assert_same(&model, &load(&path).unwrap());
    }

    #[test]
    fn a_place_without_room_is_told_with_both_sizes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        check_place(&path, 1).unwrap();
        let error = check_place(&path, u64::MAX).unwrap_err();
        assert!(matches!(error, ModelError::NoRoom { needed: u64::MAX, free, .. } if free > 0), "{error}");
        assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is left");
        let error = save(&searched_here(small()), "/dev/null".as_ref()).unwrap_err().to_string();
        assert!(error.contains("not a regular file"), "{error}");
    }
}
