//! Completions that the caller holds.

#![allow(unsafe_code)] // an exported name

use crate::handles::Table;
use crate::options::CompletionView;
use crate::outcome::{Outcome, guard};
use beo_ipc::Completion;

/// A completed grid in shared memory. From `beo_subscriber_take_completion` to `beo_completion_release`.
pub struct CompletionHandle;

static COMPLETIONS: Table<Completion> = Table::new();

/// Keeps a completion for the caller: where its arrays are, and its handle.
pub(crate) fn keep(completion: Completion) -> (CompletionView, *mut CompletionHandle) {
    let view = CompletionView {
        size: size_of::<CompletionView>() as u32,
        reserved: 0,
        voxel_count: completion.occupancy().len(),
        // Shared memory does not move when the completion does.
        occupancy: completion.occupancy().as_ptr(),
        deviation: completion.deviation().as_ptr(),
        header: *completion.header(),
    };
    (view, COMPLETIONS.insert(completion))
}

/// Releases a completion: the pointers in its view end here.
#[unsafe(no_mangle)]
pub extern "C" fn beo_completion_release(completion: *mut CompletionHandle) -> Outcome {
    guard(|| {
        COMPLETIONS.remove(completion)?;
        Ok(Outcome::Ok)
    })
}
