//! The safetensors format (Hugging Face, version 0.4 and later): a length in eight bytes, a JSON header of so many bytes, and the tensors
//! that it lists, one after the other without gaps.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, Write};

/// Bytes of the header's length; the header is filled up to a multiple of them.
const LENGTH: usize = 8;
/// The key of the header that is no tensor.
const TEXTS: &str = "__metadata__";

/// Type of a tensor's values, in the order in which they lie in a file, the last first: wide ones come before narrow ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) enum Dtype {
    U8,
    F16,
    U32,
    F32,
    F64,
}

impl Dtype {
    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F16 => 2,
            Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl fmt::Display for Dtype {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// The bytes are no safetensors file with tensors of these types.
#[derive(Debug, thiserror::Error)]
pub(super) enum ContainerError {
    #[error("its header is damaged ({0})")]
    Json(serde_json::Error),
    #[error("tensor `{0}` does not begin where the one before it ends")]
    Gap(String),
    #[error("tensor `{name}` of {dtype} {shape:?} has {bytes} bytes")]
    Size { name: String, dtype: Dtype, shape: Vec<usize>, bytes: usize },
}

/// A tensor of a file, as bytes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tensor<'a> {
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    /// Little-endian values in C order.
    pub data: &'a [u8],
}

/// A tensor in the header.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct TensorInfo {
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    /// First byte and the one after the last, from the end of the header.
    pub data_offsets: [usize; 2],
}

/// The header of a file.
#[derive(Debug, Deserialize)]
pub(super) struct Tensors {
    #[serde(default, rename = "__metadata__")]
    texts: BTreeMap<String, String>,
    #[serde(flatten)]
    infos: BTreeMap<String, TensorInfo>,
}

impl Tensors {
    /// Reads a header: its tensors follow each other without gaps, and have as many bytes as their types and shapes say.
    pub fn parse(header: &[u8]) -> Result<Self, ContainerError> {
        let tensors: Self = serde_json::from_slice(header).map_err(ContainerError::Json)?;
        let mut in_order: Vec<(&String, &TensorInfo)> = tensors.infos.iter().collect();
        in_order.sort_by_key(|(_, info)| info.data_offsets);
        let mut end = 0;
        for (name, info) in in_order {
            let [first, last] = info.data_offsets;
            if first != end || last < first {
                return Err(ContainerError::Gap(name.clone()));
            }
            let bytes = info.shape.iter().try_fold(info.dtype.bytes(), |bytes, side| bytes.checked_mul(*side));
            if bytes != Some(last - first) {
                let TensorInfo { dtype, shape, .. } = info.clone();
                return Err(ContainerError::Size { name: name.clone(), dtype, shape, bytes: last - first });
            }
            end = last;
        }
        Ok(tensors)
    }

    /// A text of the header.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.texts.get(key).map(String::as_str)
    }

    /// A tensor.
    pub fn info(&self, name: &str) -> Option<&TensorInfo> {
        self.infos.get(name)
    }

    /// All tensors with their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &TensorInfo)> {
        self.infos.iter().map(|(name, info)| (name.as_str(), info))
    }

    /// Bytes of all tensors.
    pub fn bytes(&self) -> usize {
        self.infos.values().map(|info| info.data_offsets[1]).max().unwrap_or(0)
    }
}

/// Writes a file of these tensors with one text in its header. Wide types come first, so that all lie at multiples of their size.
///
/// # Panics
/// If a tensor has not as many bytes as its type and shape say.
pub(super) fn write(mut tensors: Vec<(String, Tensor<'_>)>, [key, text]: [&str; 2], out: &mut dyn Write) -> io::Result<()> {
    tensors.sort_by(|(name, tensor), (other, than)| than.dtype.cmp(&tensor.dtype).then(name.cmp(other)));
    let mut header = format!("{{{}:{{{}:{}}}", json(TEXTS), json(key), json(text));
    let mut end = 0;
    for (name, Tensor { dtype, shape, data }) in &tensors {
        assert_eq!(data.len(), shape.iter().product::<usize>() * dtype.bytes(), "tensor `{name}` of {dtype} {shape:?}");
        let info = TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets: [end, end + data.len()] };
        end += data.len();
        header += &format!(",{}:{}", json(name), json(&info));
    }
    header.push('}');
    while !header.len().is_multiple_of(LENGTH) {
        header.push(' ');
    }
    out.write_all(&(header.len() as u64).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    tensors.iter().try_for_each(|(_, tensor)| out.write_all(tensor.data))
}

fn json(value: &(impl Serialize + ?Sized)) -> String {
    serde_json::to_string(value).expect("plain data")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use safetensors::SafeTensors;

    /// The header of a file, and the bytes after it; `None` if the file is cut within its header.
    fn header_of(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
        let (length, rest) = bytes.split_first_chunk::<LENGTH>()?;
        rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)
    }

    fn file() -> Vec<u8> {
        let tensor = |dtype, shape: &[usize], data| Tensor { dtype, shape: shape.to_vec(), data };
        let tensors = vec![
            ("b".into(), tensor(Dtype::U8, &[3], &[1, 2, 3][..])),
            ("a\"é".into(), tensor(Dtype::F16, &[2, 2], &[0; 8])),
            ("c".into(), tensor(Dtype::F64, &[1], &[7; 8])),
            ("d".into(), tensor(Dtype::F32, &[0, 4], &[])),
            ("e".into(), tensor(Dtype::U32, &[], &[9; 4])),
        ];
        let mut bytes = Vec::new();
        write(tensors, ["key", "a \"text\""], &mut bytes).unwrap();
        bytes
    }

    /// Against the format's own implementation, in both directions.
    #[test]
    fn files_are_those_of_the_reference_implementation() {
        let bytes = file();
        let theirs = SafeTensors::deserialize(&bytes).unwrap();
        let (header, data) = header_of(&bytes).unwrap();
        let ours = Tensors::parse(header).unwrap();
        assert_eq!((theirs.len(), ours.iter().count(), ours.bytes()), (5, 5, data.len()));
        for (name, tensor) in theirs.iter() {
            let TensorInfo { dtype, shape, data_offsets: [first, last] } = ours.info(name).unwrap();
            let found = (dtype.to_string(), &shape[..], &data[*first..*last]);
            assert_eq!(found, (tensor.dtype().to_string(), tensor.shape(), tensor.data()));
        }
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        assert_eq!(header.metadata().as_ref().unwrap()["key"], "a \"text\"");
        assert_eq!(ours.text("key"), Some("a \"text\""));
        assert!(ours.text("other").is_none() && ours.info("other").is_none());
        let again = safetensors::serialize(theirs.iter(), header.metadata().clone()).unwrap();
        assert_eq!(again, bytes);
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        let bytes = file();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(text.contains("\"c\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]}"), "{text}");
        for (from, to, part) in [
            ("[0,8]", "[1,8]", "tensor `c` does not begin"),
            ("[0,8]", "[0,9]", "tensor `c` of F64 [1] has 9 bytes"),
            ("[0,8]", "[9,8]", "does not begin"),
            ("F64", "F63", "unknown variant `F63`"),
            ("[2,2]", "[2,3]", "has 8 bytes"),
        ] {
            let at = text.find(from).unwrap();
            let mut wrong = bytes.clone();
            wrong[at..at + to.len()].copy_from_slice(to.as_bytes());
            let message = Tensors::parse(header_of(&wrong).unwrap().0).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
        let overflow = format!("{{\"x\":{{\"dtype\":\"F32\",\"shape\":[{0},{0},{0}],\"data_offsets\":[0,0]}}}}", 1_u64 << 60);
        assert!(Tensors::parse(overflow.as_bytes()).unwrap_err().to_string().contains("has 0 bytes"));
    }

    proptest! {
        /// Whatever it refuses or takes, so does the reference implementation, of files with these types.
        #[test]
        fn a_changed_byte_is_judged_as_by_the_reference_implementation(at in 0..500_usize, value: u8) {
            let mut bytes = file();
            let at = at % bytes.len();
            bytes[at] = value;
            let is_taken = header_of(&bytes).is_some_and(|(header, data)| Tensors::parse(header).is_ok_and(|t| t.bytes() == data.len()));
            prop_assert!(!is_taken || SafeTensors::deserialize(&bytes).is_ok());
        }
    }
}
