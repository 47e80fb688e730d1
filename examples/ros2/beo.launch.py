"""Starts the daemon and its node for ROS 2.

    ros2 launch examples/ros2/beo.launch.py depth:=/camera/camera/depth/image_rect_raw info:=/camera/camera/depth/camera_info

Both programs are looked for in PATH; `bin:=DIR/` names another place.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution

ARGUMENTS = {
    "bin": ("", "folder of beo and beo-ros2, with a slash at its end; empty for PATH"),
    "models": ("models", "folder of the models"),
    "model": ("household.safetensors", "model file"),
    "instance": ("default", "instance of the daemon"),
    "depth": ("/camera/camera/depth/image_rect_raw", "depth image, 32FC1 or 16UC1"),
    "info": ("/camera/camera/depth/camera_info", "its camera_info"),
    "labels": ("segmentation", "label image, where segmentation is topic"),
    "segmentation": ("own", "own: what stands on a table; topic: the label image"),
    "tf": ("false", "publish the objects' frames"),
}


def generate_launch_description():
    of = LaunchConfiguration
    declared = [DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in ARGUMENTS.items()]
    daemon = ExecuteProcess(
        cmd=[[of("bin"), "beo"], "serve", "--instance", of("instance"), "--model", PathJoinSubstitution([of("models"), of("model")])],
        output="screen",
    )
    node = ExecuteProcess(
        cmd=[
            [of("bin"), "beo-ros2"],
            "--ros-args",
            "-p", ["instance:=", of("instance")],
            "-p", ["segmentation:=", of("segmentation")],
            "-p", ["tf:=", of("tf")],
            "-r", ["depth/image:=", of("depth")],
            "-r", ["depth/camera_info:=", of("info")],
            "-r", ["segmentation:=", of("labels")],
        ],
        output="screen",
    )
    return LaunchDescription([*declared, daemon, node])
