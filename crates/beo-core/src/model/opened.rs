//! A model file that is open: its header, checked, and its tensors, each read and checked where it is asked for.
//!
//! They are read, not mapped, whatever their size, but for the basis of a large grid ([`Opened::mapped`]): a file that is rewritten or cut
//! meanwhile gives an error here, where a mapping would end the process by a signal.

use super::FORMAT_VERSION;
use super::container::{Dtype, TensorInfo, Tensors};
use super::error::ModelError;
use super::header::{Header, KEY, Table, check_metadata, header_checksum, level_name};
use super::mapping::{self, Mapped};
use crate::grid::Dims;
use crate::text::printable;
use bytemuck::Pod;
use half::f16;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes of the number that says how long the header is.
const LENGTH: u64 = 8;
/// The longest header that safetensors allows.
const LONGEST_HEADER: u64 = 100_000_000;
/// Bytes that are read at a time where a tensor is only to be checked.
const CHUNK: usize = 1 << 20;

/// An open file, or a part of one, whose header has been checked.
pub(super) struct Opened {
    path: PathBuf,
    file: Arc<File>,
    /// Its bytes in the file.
    within: Range<u64>,
    /// Where its tensors begin in the file.
    first: u64,
    tensors: Tensors,
    pub header: Header,
}

impl Opened {
    /// Opens a file and reads its header.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        let io = |source| ModelError::Io { path: path.to_owned(), source };
        // What is no regular file may keep whoever opens it waiting.
        if !path.metadata().map_err(io)?.is_file() {
            let reason = "it is not a regular file".into();
            return Err(ModelError::Invalid { path: path.to_owned(), reason });
        }
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Self::within(path, Arc::new(file), 0..length)
    }

    /// The model that lies in these bytes of a file.
    fn within(path: &Path, file: Arc<File>, within: Range<u64>) -> Result<Self, ModelError> {
        let io = |source| ModelError::Io { path: path.to_owned(), source };
        let invalid = |reason: String| ModelError::Invalid { path: path.to_owned(), reason: printable(&reason) };
        let bytes = within.end - within.start;
        if bytes < LENGTH {
            return Err(invalid(format!("it has {bytes} bytes, too few for a model")));
        }
        let mut length = [0; LENGTH as usize];
        file.read_exact_at(&mut length, within.start).map_err(io)?;
        let length = u64::from_le_bytes(length);
        if length > (bytes - LENGTH).min(LONGEST_HEADER) {
            return Err(invalid(format!("it has {bytes} bytes, and its header says that it has {length} itself")));
        }
        let head = read(&file, within.start + LENGTH, length as usize).map_err(io)?;
        let tensors = Tensors::parse(&head).map_err(|e| invalid(e.to_string()))?;
        let first = within.start + LENGTH + length;
        let wanted = tensors.bytes() as u64;
        if first + wanted != within.end {
            return Err(invalid(format!("its tensors have {wanted} bytes, of which {} are there: it was cut", within.end - first)));
        }

        let text = tensors.text(KEY).ok_or_else(|| invalid("it has no description by beo".into()))?;
        let value: serde_json::Value = serde_json::from_str(text).map_err(|e| invalid(format!("its description is damaged ({e})")))?;
        match value["metadata"]["format_version"].as_u64() {
            Some(version) if version == u64::from(FORMAT_VERSION) => {}
            Some(found) => return Err(ModelError::Format { path: path.to_owned(), found }),
            None => return Err(invalid("its description has no format version".into())),
        }
        let header: Header = serde_json::from_value(value).map_err(|e| invalid(format!("its description is damaged ({e})")))?;
        // A flipped bit can leave every value as it was, in another spelling (`1E-5`), which the checksum of the values does not see.
        if serde_json::to_string(&header).expect("plain data") != text {
            return Err(invalid("its description is not spelled as it was written".into()));
        }
        let length = |info: &TensorInfo| info.data_offsets[1] - info.data_offsets[0];
        let entry = |(name, info): (&str, &TensorInfo)| (name.to_owned(), (info.dtype.to_string(), info.shape.clone(), length(info)));
        let table: Table = tensors.iter().map(entry).collect();
        if header_checksum(&header.metadata, &header.checksums, &table) != header.checksum {
            return Err(invalid("its header does not match its checksum".into()));
        }
        Ok(Self { path: path.to_owned(), file, within, first, tensors, header })
    }

    /// Its bytes.
    pub fn len(&self) -> u64 {
        self.within.end - self.within.start
    }

    /// The model of a smaller grid that the file holds.
    pub fn level(&self, dims: Dims) -> Result<Self, ModelError> {
        let name = level_name(dims);
        let level = Self::within(&self.path, self.file.clone(), self.range(self.tensor(&name)?))?;
        if level.header.metadata.dims != dims {
            return Err(self.invalid(format!("tensor `{name}` is a model of other shapes")));
        }
        Ok(level)
    }

    /// Number of columns of the basis, after the description and the basis have been checked against each other.
    pub fn rank(&self) -> Result<usize, ModelError> {
        let rank = self.columns("basis")?;
        if self.header.metadata.classes.is_empty() || rank == 0 {
            return Err(self.invalid("it has no class or no basis"));
        }
        check_metadata(&self.header.metadata).map_err(|reason| self.invalid(reason))?;
        self.expect("basis", Dtype::F16, &[self.header.metadata.dims.voxels(), rank])?;
        Ok(rank)
    }

    /// That the file cannot be used, and why.
    pub fn invalid(&self, reason: impl Into<String>) -> ModelError {
        ModelError::Invalid { path: self.path.clone(), reason: printable(&reason.into()) }
    }

    /// Columns of a tensor, 0 if it has no rows and columns.
    pub fn columns(&self, name: &str) -> Result<usize, ModelError> {
        Ok(self.tensor(name)?.shape.get(1).copied().unwrap_or(0))
    }

    /// Bytes of a tensor.
    pub fn bytes_of(&self, name: &str) -> Result<u64, ModelError> {
        let range = self.range(self.tensor(name)?);
        Ok(range.end - range.start)
    }

    /// Compares a tensor with its checksum without keeping it; its bytes.
    pub fn verify(&self, name: &str) -> Result<usize, ModelError> {
        let range = self.range(self.tensor(name)?);
        let mut checksum = crc32fast::Hasher::new();
        let mut at = range.start;
        while at < range.end {
            let chunk = read(&self.file, at, ((range.end - at) as usize).min(CHUNK)).map_err(|source| self.io(source))?;
            checksum.update(&chunk);
            at += chunk.len() as u64;
        }
        self.compare(name, checksum.finalize())?;
        Ok((range.end - range.start) as usize)
    }

    /// A tensor of single precision; all values are finite.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        self.numbers(name, self.values(name, Dtype::F32, shape)?, |v: &f32| v.is_finite())
    }

    /// A tensor of double precision; all values are finite.
    pub fn doubles(&self, name: &str, shape: &[usize]) -> Result<Vec<f64>, ModelError> {
        self.numbers(name, self.values(name, Dtype::F64, shape)?, |v: &f64| v.is_finite())
    }

    /// A tensor of half precision; all values are finite.
    pub fn halves(&self, name: &str, shape: &[usize]) -> Result<Vec<f16>, ModelError> {
        self.numbers(name, self.values(name, Dtype::F16, shape)?, |v: &f16| v.is_finite())
    }

    /// A tensor of whole numbers.
    pub fn words(&self, name: &str, shape: &[usize]) -> Result<Vec<u32>, ModelError> {
        self.values(name, Dtype::U32, shape)
    }

    /// A tensor of bytes.
    pub fn bytes(&self, name: &str, shape: &[usize]) -> Result<Vec<u8>, ModelError> {
        self.values(name, Dtype::U8, shape)
    }

    /// The whole file mapped, and where a tensor of half precision lies in it. It has not been checked.
    pub fn mapped(&self, name: &str) -> Result<(Arc<Mapped>, Range<usize>), ModelError> {
        let range = self.range(self.tensor(name)?);
        if !range.start.is_multiple_of(align_of::<f16>() as u64) {
            return Err(self.invalid(format!("tensor `{name}` does not lie at an even address")));
        }
        let map = mapping::map(self.file.clone()).map_err(|source| self.io(source))?;
        let range = range.start as usize..range.end as usize;
        if range.end > map.len() {
            return Err(self.invalid("it was cut while it was read"));
        }
        Ok((Arc::new(map), range))
    }

    fn io(&self, source: io::Error) -> ModelError {
        match source.kind() {
            io::ErrorKind::UnexpectedEof => self.invalid("it was cut while it was read"),
            _ => ModelError::Io { path: self.path.clone(), source },
        }
    }

    fn tensor(&self, name: &str) -> Result<&TensorInfo, ModelError> {
        self.tensors.info(name).ok_or_else(|| self.invalid(format!("tensor `{name}` is missing")))
    }

    /// Where in the file a tensor lies.
    fn range(&self, tensor: &TensorInfo) -> Range<u64> {
        self.first + tensor.data_offsets[0] as u64..self.first + tensor.data_offsets[1] as u64
    }

    fn expect(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<Range<u64>, ModelError> {
        let tensor = self.tensor(name)?;
        if tensor.dtype == dtype && tensor.shape == shape {
            return Ok(self.range(tensor));
        }
        Err(self.invalid(format!("tensor `{name}` is {} {:?} where {dtype} {shape:?} was expected", tensor.dtype, tensor.shape)))
    }

    fn compare(&self, name: &str, checksum: u32) -> Result<(), ModelError> {
        if self.header.checksums.get(name) == Some(&checksum) {
            return Ok(());
        }
        Err(self.invalid(format!("tensor `{name}` does not match its checksum")))
    }

    fn values<T: Pod>(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<Vec<T>, ModelError> {
        let range = self.expect(name, dtype, shape)?;
        // As long as its type and shape say: safetensors has compared them.
        let values = read(&self.file, range.start, (range.end - range.start) as usize / size_of::<T>()).map_err(|e| self.io(e))?;
        self.compare(name, crc32fast::hash(bytemuck::cast_slice(&values)))?;
        Ok(values)
    }

    /// The values of a tensor, all of which must be finite.
    fn numbers<T>(&self, name: &str, values: Vec<T>, is_number: impl Fn(&T) -> bool) -> Result<Vec<T>, ModelError> {
        match values.iter().position(|value| !is_number(value)) {
            None => Ok(values),
            Some(place) => Err(self.invalid(format!("tensor `{name}` holds a value that is not a number, the first at {place}"))),
        }
    }
}

/// So many values of a file, as they lie there.
fn read<T: Pod>(file: &File, at: u64, count: usize) -> io::Result<Vec<T>> {
    let mut values = Vec::new();
    // An address limit gives an error, not an abort.
    values.try_reserve_exact(count).map_err(|_| io::ErrorKind::OutOfMemory)?;
    values.resize(count, T::zeroed());
    file.read_exact_at(bytemuck::cast_slice_mut(&mut values), at)?;
    Ok(values)
}
