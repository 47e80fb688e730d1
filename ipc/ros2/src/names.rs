//! Names of topics as ROS 2 has them: relative, private (`~/x`) and absolute ones, and the rules that give others.

/// A node's name and namespace, and the rules of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names {
    /// The namespace, absolute, without a slash at its end; empty for the root.
    namespace: String,
    node: String,
    /// From, to: both in full.
    rules: Vec<(String, String)>,
}

/// A name or a rule that is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// No `:=`.
    #[error("`{0}` is no remapping: write FROM:=TO, as depth/image:=/camera/depth/image_rect_raw")]
    NoRule(String),
    /// The name of a node or of a part of a name.
    #[error("`{0}` is no name in ROS 2: use letters, digits and `_`, not starting with a digit, without `__`, parts apart by `/`")]
    BadName(String),
}

impl Names {
    /// A node `node` in `namespace`, with the remappings of the command line, among them `__node` and `__ns`.
    ///
    /// # Errors
    /// [`NameError`] that names what is wrong.
    pub fn new(namespace: &str, node: &str, remappings: &[String]) -> Result<Self, NameError> {
        let mut names = Self { namespace: namespace.trim_end_matches('/').to_owned(), node: node.to_owned(), rules: Vec::new() };
        let mut topics = Vec::new();
        for remapping in remappings {
            match remapping.split_once(":=") {
                Some(("__node" | "__name", to)) => names.node = to.to_owned(),
                Some(("__ns", to)) => names.namespace = to.trim_end_matches('/').to_owned(),
                Some((from, to)) if !from.is_empty() && !to.is_empty() => topics.push((from, to)),
                _ => return Err(NameError::NoRule(remapping.clone())),
            }
        }
        if !is_part(&names.node) {
            return Err(NameError::BadName(names.node));
        }
        if !names.namespace.is_empty() {
            check_absolute(&names.namespace)?;
        }
        for (from, to) in topics {
            let rule = (names.in_full(from)?, names.in_full(to)?);
            names.rules.push(rule);
        }
        Ok(names)
    }

    /// The node's name.
    pub fn node(&self) -> &str {
        &self.node
    }

    /// The namespace, `/` for the root.
    pub fn namespace(&self) -> &str {
        if self.namespace.is_empty() { "/" } else { &self.namespace }
    }

    /// The absolute name of a topic, after the remappings.
    ///
    /// # Errors
    /// [`NameError::BadName`].
    pub fn topic(&self, name: &str) -> Result<String, NameError> {
        let full = self.in_full(name)?;
        Ok(self.rules.iter().find(|(from, _)| *from == full).map_or(full, |(_, to)| to.clone()))
    }

    fn in_full(&self, name: &str) -> Result<String, NameError> {
        let full = match (name.strip_prefix("~/"), name.starts_with('/')) {
            (Some(private), _) => format!("{}/{}/{private}", self.namespace, self.node),
            (None, true) => name.to_owned(),
            (None, false) => format!("{}/{name}", self.namespace),
        };
        check_absolute(&full)?;
        Ok(full)
    }
}

fn check_absolute(name: &str) -> Result<(), NameError> {
    match name.strip_prefix('/') {
        Some(parts) if parts.split('/').all(is_part) => Ok(()),
        _ => Err(NameError::BadName(name.to_owned())),
    }
}

fn is_part(part: &str) -> bool {
    part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        && !part.contains("__")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(namespace: &str, rules: &[&str]) -> Result<Names, NameError> {
        Names::new(namespace, "beo", &rules.iter().map(|rule| (*rule).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn names_are_completed_and_replaced_as_ros_does() {
        let plain = names("/", &[]).unwrap();
        assert_eq!(plain.topic("depth/image").unwrap(), "/depth/image");
        assert_eq!(plain.topic("~/detections").unwrap(), "/beo/detections");
        assert_eq!(plain.topic("/tf").unwrap(), "/tf");
        let rules = ["depth/image:=/camera/depth/image_rect_raw", "~/detections:=found", "__ns:=/robot/left", "__node:=eyes"];
        let mapped = names("/elsewhere", &rules).unwrap();
        assert_eq!((mapped.namespace(), mapped.node()), ("/robot/left", "eyes"));
        assert_eq!(mapped.topic("depth/image").unwrap(), "/camera/depth/image_rect_raw");
        assert_eq!(mapped.topic("depth/camera_info").unwrap(), "/robot/left/depth/camera_info");
        assert_eq!(mapped.topic("~/detections").unwrap(), "/robot/left/found");
        assert_eq!(mapped.topic("~/markers").unwrap(), "/robot/left/eyes/markers");
    }

    #[test]
    fn what_is_no_name_is_named() {
        for rule in ["depth/image", ":=x", "a:="] {
            assert_eq!(names("/", &[rule]), Err(NameError::NoRule(rule.into())));
        }
        for (rule, bad) in [("a:=b//c", "/b//c"), ("a:=1x", "/1x"), ("a b:=c", "/a b"), ("__ns:=robot", "robot"), ("__node:=a-b", "a-b")] {
            assert_eq!(names("/", &[rule]), Err(NameError::BadName(bad.into())), "{rule}");
        }
    }
}
