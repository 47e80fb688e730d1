//! The model file: as damage leaves it, and as someone makes it who knows how its checksums are formed.

use super::small_model;
use beo_core::grid::Observation;
use beo_core::model::{Metadata, load};
use beo_core::perception::{Perceiver, Percept, Query};
use safetensors::tensor::{SafeTensors, TensorView, serialize};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// A model file. Where only its checksums are wrong it is tried with right ones too.
pub fn run(data: &[u8]) {
    open(data);
    if let Some(sealed) = sealed(data) {
        open(&sealed);
    }
}

/// Loads the bytes as a model and, where that succeeds, asks it.
fn open(data: &[u8]) {
    let path = small_model::scratch_file("model");
    std::fs::write(&path, data).expect("a place for temporary files");
    match load(&path) {
        Ok(model) => {
            let dims = model.dims();
            if let Ok(perceiver) = Perceiver::new(Arc::new(model)) {
                let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
                let mut observation = Observation::unknown(dims);
                (0..dims.voxels()).step_by(3).for_each(|voxel| observation.set(voxel, voxel % 2 == 0));
                let query = Query { completion: true, ..Query::default() };
                if let Ok(classified) = perceiver.classify(&observation, &query, &mut work, &mut percept) {
                    let _ = classified.complete();
                }
            }
        }
        Err(error) => assert!(!error.to_string().contains(char::is_control), "an error of one line that a terminal can show"),
    }
    let _ = std::fs::remove_file(&path);
}

#[derive(Serialize, Deserialize)]
struct Header {
    metadata: Metadata,
    checksums: BTreeMap<String, u32>,
    checksum: u32,
}

/// The same file with the checksums that belong to it, if it is whole enough to have any.
fn sealed(data: &[u8]) -> Option<Vec<u8>> {
    let (_, info) = SafeTensors::read_metadata(data).ok()?;
    let mut header: Header = serde_json::from_str(info.metadata().as_ref()?.get("beo")?).ok()?;
    let tensors = SafeTensors::deserialize(data).ok()?.tensors();
    header.checksums = tensors.iter().map(|(name, tensor)| (name.clone(), crc32fast::hash(tensor.data()))).collect();
    type Table = BTreeMap<String, (String, Vec<usize>, usize)>;
    let row = |tensor: &TensorView<'_>| (tensor.dtype().to_string(), tensor.shape().to_vec(), tensor.data().len());
    let table: Table = tensors.iter().map(|(name, tensor)| (name.clone(), row(tensor))).collect();
    let text = serde_json::to_string(&(&header.metadata, &header.checksums, &table)).ok()?;
    header.checksum = crc32fast::hash(text.as_bytes());
    let description = HashMap::from([("beo".to_owned(), serde_json::to_string(&header).ok()?)]);
    serialize(tensors, Some(description)).ok()
}

/// A small multiple of the file: triangles become matrices, halves become floats, and queries need scratch memory.
pub fn most_bytes(len: usize) -> usize {
    64 * len + (16 << 20)
}

/// Seeds.
pub fn seeds() -> Vec<Vec<u8>> {
    vec![small_model::bytes()]
}
