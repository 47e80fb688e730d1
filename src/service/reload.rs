//! Another model, loaded and checked in its own thread while the one before serves.

use super::answer::Answerer;
use super::recipe::Recipe;
use beo_core::grid::Dims;
use beo_ipc::ReloadCall;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// A model that is being loaded.
pub struct Reload {
    path: PathBuf,
    /// Who asked, if it was asked for by a call.
    call: Option<ReloadCall>,
    thread: std::io::Result<JoinHandle<Result<Answerer, String>>>,
}

/// The outcome of loading it.
pub struct Reloaded {
    /// The model's file.
    pub path: PathBuf,
    /// Who waits for an answer.
    pub call: Option<ReloadCall>,
    /// The answerer from now on, or why there is none.
    pub outcome: Result<Answerer, String>,
}

impl Reload {
    /// Begins to load a model for grids of `dims`.
    pub fn start(recipe: &Recipe, path: PathBuf, dims: Dims, call: Option<ReloadCall>) -> Self {
        let (recipe, file) = (recipe.clone(), path.clone());
        let load = move || load_alone(&recipe, &file, dims);
        Self { path, call, thread: std::thread::Builder::new().name("beo-reload".into()).spawn(load) }
    }

    /// Whether [`Self::finish`] returns at once.
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().map_or(true, JoinHandle::is_finished)
    }

    /// Waits for the outcome.
    pub fn finish(self) -> Reloaded {
        let outcome = match self.thread {
            Ok(thread) => thread.join().unwrap_or_else(|_| Err(format!("loading {} failed: see the log", self.path.display()))),
            Err(error) => Err(format!("no thread could be started to load {}: {error}", self.path.display())),
        };
        Reloaded { path: self.path, call: self.call, outcome }
    }

    /// Gives it up, and says so to who waits. The thread ends with the process.
    pub fn abandon(self, model_id: u64) {
        if let Some(call) = self.call {
            call.answer(model_id, Some("the daemon is stopping"));
        }
    }
}

/// On one core, in a pool of its own: queries do not wait behind it.
fn load_alone(recipe: &Recipe, path: &Path, dims: Dims) -> Result<Answerer, String> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|error| error.to_string())?;
    pool.install(|| recipe.replace(path, dims)).map_err(|error| error.to_string())
}
