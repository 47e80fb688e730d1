//! Accessors of a glTF document: arrays of numbers within buffers, densely laid or with strides, sparse values put in.

use super::document::{Accessor, Document, Kind};
use std::borrow::Cow;

const BYTE: u16 = 5120;
const UNSIGNED_BYTE: u16 = 5121;
const SHORT: u16 = 5122;
const UNSIGNED_SHORT: u16 = 5123;
const UNSIGNED_INT: u16 = 5125;
const FLOAT: u16 = 5126;

/// The document and its buffers, from which accessors are read.
pub(super) struct Reader<'a> {
    pub document: &'a Document,
    pub buffers: &'a [Cow<'a, [u8]>],
    /// Bytes of the file and its buffers: no array has more elements.
    pub most: usize,
}

fn size(component_type: u16) -> Result<usize, String> {
    match component_type {
        BYTE | UNSIGNED_BYTE => Ok(1),
        SHORT | UNSIGNED_SHORT => Ok(2),
        UNSIGNED_INT | FLOAT => Ok(4),
        other => Err(format!("component type {other}: expected 5120 to 5126")),
    }
}

/// One number, without normalisation.
fn component(bytes: &[u8], component_type: u16) -> f64 {
    match (component_type, bytes) {
        (BYTE, &[a, ..]) => f64::from(a as i8),
        (UNSIGNED_BYTE, &[a, ..]) => f64::from(a),
        (SHORT, &[a, b, ..]) => f64::from(i16::from_le_bytes([a, b])),
        (UNSIGNED_SHORT, &[a, b, ..]) => f64::from(u16::from_le_bytes([a, b])),
        (UNSIGNED_INT, &[a, b, c, d, ..]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        (FLOAT, &[a, b, c, d, ..]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => f64::NAN,
    }
}

/// Divisor of normalised whole numbers.
fn divisor(component_type: u16) -> f64 {
    match component_type {
        BYTE => 127.0,
        UNSIGNED_BYTE => 255.0,
        SHORT => 32767.0,
        UNSIGNED_SHORT => 65535.0,
        _ => 1.0,
    }
}

/// Elements in a buffer.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn get(&self, n: usize) -> &'a [u8] {
        &self.bytes[n * self.stride..n * self.stride + self.size]
    }
}

impl<'a> Reader<'a> {
    /// `count` elements of `size` bytes in a buffer view.
    fn elements(&self, view: u32, byte_offset: u64, count: usize, size: usize) -> Result<Elements<'a>, String> {
        let found = self.document.views.get(view as usize).ok_or_else(|| format!("buffer view {view} does not exist"))?;
        let buffer = self.buffers.get(found.buffer as usize).ok_or_else(|| format!("buffer {} does not exist", found.buffer))?;
        let outside = || format!("buffer view {view} reaches beyond its buffer of {} bytes", buffer.len());
        let start = usize::try_from(found.byte_offset).map_err(|_| outside())?;
        let length = usize::try_from(found.byte_length).map_err(|_| outside())?;
        let bytes: &'a [u8] = buffer.get(start..).and_then(|rest| rest.get(..length)).ok_or_else(outside)?;
        let stride = found.byte_stride.map_or(size, usize::from);
        if stride < size {
            return Err(format!("buffer view {view} has a stride of {stride} bytes: expected at least {size}"));
        }
        let short = || format!("{count} elements of {size} bytes do not fit into buffer view {view} of {length} bytes");
        let bytes = bytes.get(usize::try_from(byte_offset).map_err(|_| short())?..).ok_or_else(short)?;
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        match needed {
            Some(needed) if needed <= bytes.len() => Ok(Elements { bytes, stride, size }),
            _ => Err(short()),
        }
    }

    /// An accessor by its index, with a count that the file can hold.
    fn accessor(&self, index: u32) -> Result<(&'a Accessor, usize), String> {
        let accessor = self.document.accessors.get(index as usize).ok_or_else(|| format!("accessor {index} does not exist"))?;
        let count = usize::try_from(accessor.count).ok().filter(|count| *count <= self.most);
        let count = count.ok_or_else(|| format!("accessor {index} has {} elements, more than the file has bytes", accessor.count))?;
        Ok((accessor, count))
    }

    /// Number of elements of an accessor.
    pub fn count(&self, index: u32) -> Result<usize, String> {
        Ok(self.accessor(index)?.1)
    }

    /// Calls `take` with each of the positions.
    pub fn positions(&self, index: u32, mut take: impl FnMut([f64; 3])) -> Result<(), String> {
        let (accessor, count) = self.accessor(index)?;
        let kind = accessor.component_type;
        let size = size(kind)?;
        if accessor.kind != Kind::Vec3 {
            return Err(format!("accessor {index} holds positions, but is not of type VEC3"));
        }
        let divisor = if accessor.normalized { divisor(kind) } else { 1.0 };
        let vector = |bytes: &[u8]| {
            [0, 1, 2].map(|axis| {
                (component(&bytes[axis * size..], kind) / divisor).max(if accessor.normalized { -1.0 } else { f64::NEG_INFINITY })
            })
        };
        let dense = accessor.view.map(|view| self.elements(view, accessor.byte_offset, count, 3 * size)).transpose()?;
        let mut sparse = Vec::new();
        if let Some(part) = &accessor.sparse {
            let fewer = usize::try_from(part.count)
                .ok()
                .filter(|n| *n <= count)
                .ok_or_else(|| format!("accessor {index} has more sparse values than elements"))?;
            let index_type = part.indices.component_type.unwrap_or(UNSIGNED_INT);
            let places = self.elements(part.indices.view, part.indices.byte_offset, fewer, self::size(index_type)?)?;
            let values = self.elements(part.values.view, part.values.byte_offset, fewer, 3 * size)?;
            sparse.extend((0..fewer).map(|n| (component(places.get(n), index_type) as usize, vector(values.get(n)))));
            if !sparse.is_sorted_by_key(|(place, _)| *place) || sparse.last().is_some_and(|(place, _)| *place >= count) {
                return Err(format!("the sparse indices of accessor {index} are not increasing and below {count}"));
            }
        } else if dense.is_none() && count > 0 {
            return Err(format!("accessor {index} holds positions, but names no buffer view: all would be zero"));
        }
        let mut sparse = sparse.into_iter().peekable();
        for n in 0..count {
            let mut value = dense.as_ref().map_or([0.0; 3], |dense| vector(dense.get(n)));
            while let Some((_, given)) = sparse.next_if(|(place, _)| *place == n) {
                value = given;
            }
            if !value.iter().all(|c| c.is_finite()) {
                return Err(format!("position {n} of accessor {index} is not a number or infinite: export the mesh again"));
            }
            take(value);
        }
        Ok(())
    }

    /// The indices of an accessor, each below `vertices`.
    pub fn indices(&self, index: u32, vertices: usize) -> Result<Vec<u32>, String> {
        let (accessor, count) = self.accessor(index)?;
        let kind = accessor.component_type;
        if accessor.kind != Kind::Scalar || !matches!(kind, UNSIGNED_BYTE | UNSIGNED_SHORT | UNSIGNED_INT) {
            return Err(format!(
                "accessor {index} holds indices: expected SCALAR of unsigned bytes, shorts or ints (5121, 5123, 5125), found type {kind}"
            ));
        }
        let view = accessor.view.filter(|_| accessor.sparse.is_none());
        let view = view.ok_or_else(|| format!("accessor {index} holds indices, but is sparse or names no buffer view"))?;
        let size = size(kind)?;
        let elements = self.elements(view, accessor.byte_offset, count, size)?;
        // The largest value of a type ends a strip where an engine restarts it, which glTF does not allow: it is out of range here.
        let index = |n: usize| {
            let vertex = component(elements.get(n), kind) as usize;
            if vertex < vertices {
                Ok(vertex as u32)
            } else {
                Err(format!("index {n} of accessor {index} names vertex {vertex}: expected 0 to {}", vertices.saturating_sub(1)))
            }
        };
        (0..count).map(index).collect()
    }
}
