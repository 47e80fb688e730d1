//! Errors of the libraries as Python's exceptions, with the libraries' own words.

use beo_core::learning::TrainError;
use beo_core::model::ModelError;
use beo_core::perception::PerceiveError;
use beo_ipc::{LoanError, OpenError, ReconnectError, SendError};
use beo_shapes::ReadError;
use pyo3::PyErr;
use pyo3::exceptions::{PyConnectionError, PyMemoryError, PyOSError, PyValueError};
use std::fmt::Display;
use std::io;

/// Arguments, or content, that make no sense.
pub fn invalid(text: impl Display) -> PyErr {
    PyValueError::new_err(text.to_string())
}

/// The exception of a model file.
pub fn of_model_file(error: &ModelError) -> PyErr {
    match error {
        // The kind decides between FileNotFoundError, PermissionError and so on; the text names the file.
        ModelError::Io { source, .. } => io::Error::new(source.kind(), error.to_string()).into(),
        ModelError::NoRoom { .. } => PyOSError::new_err(error.to_string()),
        _ => invalid(error),
    }
}

/// The exception of a query.
pub fn of_perceiving(error: &PerceiveError) -> PyErr {
    match error {
        PerceiveError::File(error) => of_model_file(error),
        PerceiveError::Memory { .. } | PerceiveError::Bound { .. } => PyMemoryError::new_err(error.to_string()),
        _ => invalid(error),
    }
}

/// The exception of a training.
pub fn of_training(error: &TrainError) -> PyErr {
    match error {
        TrainError::Perceive(error) => of_perceiving(error),
        _ => invalid(error),
    }
}

/// The exception of a shape's file.
pub fn of_shape_file(error: &ReadError) -> PyErr {
    match error {
        ReadError::Open { source, .. } => io::Error::new(source.kind(), error.to_string()).into(),
        _ => invalid(error),
    }
}

/// The exception of a role that could not be opened. `ConnectionError` is the one for which waiting helps.
pub fn of_opening(error: &OpenError) -> PyErr {
    match error {
        OpenError::NotRunning { .. } => PyConnectionError::new_err(error.to_string()),
        OpenError::BadDims(_) => invalid(error),
        _ => PyOSError::new_err(error.to_string()),
    }
}

/// The exception of a role that reconnects.
pub fn of_reconnecting(error: &ReconnectError) -> PyErr {
    match error {
        ReconnectError::Open(error) => of_opening(error),
        ReconnectError::Loan(error) => of_loaning(error),
        _ => PyOSError::new_err(error.to_string()),
    }
}

/// The exception of memory that cannot be had.
fn of_loaning(error: &LoanError) -> PyErr {
    PyOSError::new_err(error.to_string())
}

/// The exception of something that was not sent.
pub fn of_sending(error: &SendError) -> PyErr {
    match error {
        SendError::ProducerGone => PyConnectionError::new_err(error.to_string()),
        _ => PyOSError::new_err(error.to_string()),
    }
}
