//! Instance names and the names of an instance's services.

use std::fmt;
use std::str::FromStr;

/// The instance that is meant when none is named.
pub const DEFAULT_INSTANCE: &str = "default";

/// Most bytes of an instance name.
pub const MAX_INSTANCE_LEN: usize = 64;

/// A valid instance name: 1 to [`MAX_INSTANCE_LEN`] ASCII letters, digits, `-`, `_` or `.`, not starting with `.`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct InstanceName(String);

/// Why a text is not an instance name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum InstanceNameError {
    /// No character at all.
    #[error("the instance name is empty: leave it out for `{DEFAULT_INSTANCE}`")]
    Empty,
    /// More than [`MAX_INSTANCE_LEN`] bytes.
    #[error("the instance name has {0} bytes: at most {MAX_INSTANCE_LEN} are possible")]
    TooLong(usize),
    /// A character that is not allowed.
    #[error("the instance name has {0:?}: use letters, digits, `-`, `_` and `.` (not first)")]
    BadCharacter(char),
}

impl InstanceName {
    /// Checks a name.
    pub fn new(name: &str) -> Result<Self, InstanceNameError> {
        if name.is_empty() {
            return Err(InstanceNameError::Empty);
        }
        if name.len() > MAX_INSTANCE_LEN {
            return Err(InstanceNameError::TooLong(name.len()));
        }
        if name.starts_with('.') {
            return Err(InstanceNameError::BadCharacter('.'));
        }
        match name.chars().find(|&c| !(c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.'))) {
            Some(bad) => Err(InstanceNameError::BadCharacter(bad)),
            None => Ok(Self(name.to_owned())),
        }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Name of the service of observations.
    pub fn observation(&self) -> String {
        self.service("observation")
    }

    /// Name of the service of percepts.
    pub fn percept(&self) -> String {
        self.service("percept")
    }

    /// Name of the service of completions.
    pub fn completion(&self) -> String {
        self.service("completion")
    }

    /// Name of the service of the daemon's status.
    pub fn status(&self) -> String {
        self.service("status")
    }

    /// Name of the event that producers send after an observation.
    pub fn observed(&self) -> String {
        self.service("observed")
    }

    /// Name of the event that the daemon sends after a percept.
    pub fn perceived(&self) -> String {
        self.service("perceived")
    }

    /// Name of the service of control calls.
    pub fn control(&self) -> String {
        self.service("control")
    }

    /// Name of the service of pictures.
    pub fn picture(&self) -> String {
        self.service("picture")
    }

    fn service(&self, channel: &str) -> String {
        format!("beo/{}/{channel}", self.0)
    }
}

impl Default for InstanceName {
    fn default() -> Self {
        Self(DEFAULT_INSTANCE.to_owned())
    }
}

impl fmt::Display for InstanceName {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl FromStr for InstanceName {
    type Err = InstanceNameError;

    fn from_str(name: &str) -> Result<Self, InstanceNameError> {
        Self::new(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_services_of_an_instance_are_named_as_published() {
        let instance = InstanceName::default();
        assert_eq!(instance.observation(), "beo/default/observation");
        assert_eq!(instance.percept(), "beo/default/percept");
        assert_eq!(instance.completion(), "beo/default/completion");
        assert_eq!(instance.status(), "beo/default/status");
        assert_eq!(instance.observed(), "beo/default/observed");
        assert_eq!(instance.perceived(), "beo/default/perceived");
        assert_eq!(instance.control(), "beo/default/control");
        assert_eq!(instance.picture(), "beo/default/picture");
    }

    #[test]
    fn names_that_could_be_taken_for_something_else_are_refused() {
        for good in ["a", "left_arm-2.1", "A", &"x".repeat(64)] {
            assert_eq!(InstanceName::new(good).unwrap().as_str(), good);
        }
        assert_eq!(InstanceName::new(""), Err(InstanceNameError::Empty));
        assert_eq!(InstanceName::new(&"x".repeat(65)), Err(InstanceNameError::TooLong(65)));
        for (bad, character) in [("a/b", '/'), ("../x", '.'), ("a b", ' '), ("ü", 'ü'), ("a\0", '\0'), ("a\n", '\n')] {
            assert_eq!(InstanceName::new(bad), Err(InstanceNameError::BadCharacter(character)), "{bad:?}");
        }
    }
}
