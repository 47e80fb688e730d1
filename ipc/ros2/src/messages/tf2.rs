//! `tf2_msgs`: frames.

use super::TransformStamped;

super::messages! {
    TFMessage { transforms: Vec<TransformStamped> }
}
super::topics!("tf2_msgs": TFMessage);
