//! The command line: usual flags, and ROS 2's own arguments, which are the same settings by another road.
//!
//! `--ros-args -p name:=value` stands for `--name=value`, and `-r from:=to` for `--remap=from:=to`; so one parser checks both.

use crate::names::{NameError, Names};
use beo_ipc::InstanceName;
use clap::{ArgAction, Parser, ValueEnum};
use std::ffi::OsString;
use std::time::Duration;

/// Perceives the objects of a ROS 2 depth camera by a beo daemon
///
/// Reads `depth/image` (32FC1 in metres, 16UC1 in millimetres) with `depth/camera_info`, lays a grid about each object, and asks the daemon.
/// Publishes `~/detections` (vision_msgs/Detection3DArray, with covariances), `~/completed_points` (sensor_msgs/PointCloud2), `~/markers`
/// (visualization_msgs/MarkerArray), `~/label_info` (vision_msgs/LabelInfo), `/diagnostics`, and on request `/tf`. No ROS needs to be
/// installed.
///
/// ROS arguments: --ros-args -r FROM:=TO -p NAME:=VALUE, where NAME is that of an option with `_` for `-`.
#[derive(Clone, Debug, Parser)]
#[command(name = "beo-ros2", version, args_override_self = true)]
pub struct Arguments {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    pub instance: InstanceName,
    /// Where the objects' masks come from
    #[arg(long, value_enum, default_value_t = Masks::Own)]
    pub segmentation: Masks,
    /// The images are rectified: the camera is P of camera_info, without distortion
    #[arg(long, action = ArgAction::Set, num_args = 0..=1, require_equals = true, default_value_t = false, default_missing_value = "true", value_name = "true|false")]
    pub rectified: bool,
    /// How far the stamps of a depth image and its segmentation may be apart, seconds
    #[arg(long, default_value_t = 0.01, value_name = "SECONDS")]
    pub sync_tolerance: f64,
    /// Ask for the images reliably, instead of best effort: nothing is lost, but a slow network holds the camera up
    #[arg(long, action = ArgAction::Set, num_args = 0..=1, require_equals = true, default_value_t = false, default_missing_value = "true", value_name = "true|false")]
    pub reliable_images: bool,
    /// Frame of everything that is published, in place of the depth image's
    #[arg(long, value_name = "FRAME")]
    pub frame_id: Option<String>,
    /// Publish the frames of the objects on /tf, as beo/CLASS_ID
    #[arg(long, action = ArgAction::Set, num_args = 0..=1, require_equals = true, default_value_t = false, default_missing_value = "true", value_name = "true|false")]
    pub tf: bool,
    /// Name of the node
    #[arg(long, default_value = "beo", value_name = "NAME")]
    pub node_name: String,
    /// Namespace of the node
    #[arg(long, default_value = "/", value_name = "NAMESPACE")]
    pub namespace: String,
    /// Another name for a topic, FROM:=TO, as depth/image:=/camera/depth/image_rect_raw; may be repeated
    #[arg(long, short = 'r', value_name = "FROM:=TO")]
    pub remap: Vec<String>,
    /// DDS domain, 0 to 232 [default: ROS_DOMAIN_ID, or 0]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u16).range(0..=232))]
    pub domain_id: Option<u16>,
    /// Speak to processes of this machine only [default: where ROS_LOCALHOST_ONLY=1 or ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST]
    #[arg(long, action = ArgAction::Set, num_args = 0..=1, require_equals = true, default_missing_value = "true", value_name = "true|false")]
    pub localhost_only: Option<bool>,
}

/// Where masks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Masks {
    /// Objects that stand on a table, found in the depth image
    Own,
    /// The topic `segmentation`: mono8, 16UC1 or 32SC1, a number for each object
    Topic,
}

/// A command line that makes no sense.
#[derive(Debug, thiserror::Error)]
pub enum ArgumentError {
    /// Of what ROS gives.
    #[error("--ros-args: {0}")]
    Ros(String),
    /// A value.
    #[error("{0}")]
    Value(String),
    /// A name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// A usage error of clap, or its texts of help and version.
    #[error(transparent)]
    Usage(#[from] clap::Error),
}

impl Arguments {
    /// From a command line, the program's name first.
    ///
    /// # Errors
    /// [`ArgumentError`].
    pub fn parse_from_line(line: impl IntoIterator<Item = OsString>) -> Result<Self, ArgumentError> {
        let arguments = Self::try_parse_from(translated(line)?)?;
        arguments.tolerance()?;
        arguments.names()?;
        Ok(arguments)
    }

    /// The node's names.
    ///
    /// # Errors
    /// [`ArgumentError::Name`].
    pub fn names(&self) -> Result<Names, ArgumentError> {
        Ok(Names::new(&self.namespace, &self.node_name, &self.remap)?)
    }

    /// How far stamps may be apart.
    ///
    /// # Errors
    /// [`ArgumentError::Value`] if that is no length of time.
    pub fn tolerance(&self) -> Result<Duration, ArgumentError> {
        let text = self.sync_tolerance;
        Duration::try_from_secs_f64(text).map_err(|_| ArgumentError::Value(format!("sync tolerance {text}: use seconds from 0 on")))
    }

    /// The domain of the flag, or of the environment.
    ///
    /// # Errors
    /// [`ArgumentError::Value`] if the environment's is none.
    pub fn domain(&self) -> Result<u16, ArgumentError> {
        match (self.domain_id, std::env::var("ROS_DOMAIN_ID")) {
            (Some(id), _) => Ok(id),
            (None, Ok(text)) if !text.is_empty() => text
                .parse()
                .ok()
                .filter(|id| *id <= 232)
                .ok_or_else(|| ArgumentError::Value(format!("ROS_DOMAIN_ID is `{text}`: use a number from 0 to 232"))),
            _ => Ok(0),
        }
    }

    /// Whether only this machine is spoken to.
    pub fn is_local(&self) -> bool {
        let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|found| found.eq_ignore_ascii_case(value));
        self.localhost_only.unwrap_or_else(|| is("ROS_LOCALHOST_ONLY", "1") || is("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"))
    }
}

/// The command line with ROS's arguments as flags.
fn translated(line: impl IntoIterator<Item = OsString>) -> Result<Vec<OsString>, ArgumentError> {
    let mut plain = Vec::new();
    let mut line = line.into_iter();
    while let Some(argument) = line.next() {
        if argument != "--ros-args" {
            plain.push(argument);
            continue;
        }
        while let Some(argument) = line.next() {
            let text = argument.to_string_lossy().into_owned();
            let mut value = || {
                let value = line.next().ok_or_else(|| ArgumentError::Ros(format!("{text} needs a value")))?;
                Ok::<_, ArgumentError>(value.to_string_lossy().into_owned())
            };
            match text.as_str() {
                "--" => break,
                "-r" | "--remap" => plain.push(format!("--remap={}", value()?).into()),
                "-p" | "--param" => plain.push(parameter(&value()?)?.into()),
                other => {
                    return Err(ArgumentError::Ros(format!("`{other}` is not known: use -r FROM:=TO and -p NAME:=VALUE")));
                }
            }
        }
    }
    Ok(plain)
}

/// The flag that a parameter stands for.
fn parameter(text: &str) -> Result<String, ArgumentError> {
    match text.split_once(":=") {
        Some((name, value)) if !name.is_empty() => {
            let value = value.trim_matches(['"', '\'']);
            Ok(format!("--{}={value}", name.replace('_', "-")))
        }
        _ => Err(ArgumentError::Ros(format!("`{text}` is no parameter: write NAME:=VALUE"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &[&str]) -> Result<Arguments, ArgumentError> {
        Arguments::parse_from_line(std::iter::once("beo-ros2").chain(line.iter().copied()).map(OsString::from))
    }

    #[test]
    fn parameters_and_flags_are_the_same_and_the_last_one_counts() {
        let line =
            ["--tf", "--sync-tolerance", "0.5", "--ros-args", "-p", "sync_tolerance:=0.02", "-p", "segmentation:=topic", "-r", "a:=b"];
        let arguments =
            parsed(&[&line[..], &["-p", "rectified:=true", "-p", "instance:='left'", "--", "--frame-id", "table"]].concat()).unwrap();
        assert_eq!((arguments.tf, arguments.rectified, arguments.segmentation), (true, true, Masks::Topic));
        assert_eq!((arguments.tolerance().unwrap(), arguments.instance.as_str()), (Duration::from_millis(20), "left"));
        assert_eq!((arguments.remap, arguments.frame_id), (vec!["a:=b".to_owned()], Some("table".to_owned())));
        assert!(!parsed(&["--tf", "--ros-args", "-p", "tf:=false"]).unwrap().tf);
    }

    #[test]
    fn a_wrong_command_line_says_what_is_wrong() {
        for (line, word) in [
            (&["--ros-args", "-p", "tf"][..], "NAME:=VALUE"),
            (&["--ros-args", "-p"], "-p needs a value"),
            (&["--ros-args", "--params-file", "a.yaml"], "`--params-file` is not known"),
            (&["--ros-args", "-p", "colour:=red"], "--colour"),
            (&["--ros-args", "-r", "a"], "no remapping"),
            (&["--sync-tolerance=-1"], "sync tolerance -1"),
            (&["--sync-tolerance=nan"], "sync tolerance NaN"),
            (&["--domain-id", "233"], "233"),
        ] {
            let text = parsed(line).unwrap_err().to_string();
            assert!(text.contains(word), "{line:?}: {text}");
        }
    }
}
