//! How a model file becomes what answers: at the start, and each time another model is asked for.

use super::answer::Answerer;
use super::error::ServeError;
use beo_core::grid::Dims;
use beo_core::model::{outline, verify};
use beo_core::perception::{Perceiver, Query};
use std::path::Path;
use std::sync::Arc;

/// Log P(s) of each class of a model, up to a constant; empty if all are the same.
pub type Prior = Arc<dyn Fn(&Perceiver) -> Vec<f64> + Send + Sync>;

/// The settings that stay when the model changes.
#[derive(Clone)]
pub struct Recipe {
    /// How it answers what observations do not say themselves. Its prior is replaced.
    pub query: Query,
    /// The prior over the classes of a model.
    pub prior: Prior,
    /// Bytes of memory that a model may take, if that is bounded.
    pub most: Option<u64>,
}

impl Recipe {
    /// Loads a model and prepares it, if there is memory for it.
    ///
    /// # Errors
    /// [`ServeError::Model`].
    pub fn prepare(&self, path: &Path) -> Result<Answerer, ServeError> {
        let perceiver = Perceiver::open_within(path, self.most)?;
        let query = Query { log_prior: (self.prior)(&perceiver), ..self.query.clone() };
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Answerer::new(perceiver, query, name))
    }

    /// As [`Self::prepare`], for a model that takes the place of one for grids of `dims`: every byte of it is checked, and one query
    /// answered, before it is let in.
    ///
    /// # Errors
    /// As [`Self::prepare`], [`ServeError::File`] and [`ServeError::OtherDims`].
    pub fn replace(&self, path: &Path, dims: Dims) -> Result<Answerer, ServeError> {
        // What needs no more than the file's header comes first.
        let found = outline(path)?.metadata.dims;
        if found != dims {
            return Err(ServeError::OtherDims { path: path.to_owned(), found, served: dims });
        }
        let mut answerer = self.prepare(path)?;
        verify(path)?;
        answerer.rehearse()?;
        Ok(answerer)
    }
}
