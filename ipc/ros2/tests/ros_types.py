"""Messages of ROS 2 for the DDS implementation CycloneDDS, written from their .msg files by hand."""

from dataclasses import dataclass
from types import new_class

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint8, uint16, uint32


def message(package):
    """A dataclass with the type name that ROS 2 gives it on the wire."""

    def declare(cls):
        name = f"{package}::msg::dds_::{cls.__name__}_"
        body = {"__annotations__": cls.__annotations__, "__module__": cls.__module__}
        return dataclass(new_class(cls.__name__, (IdlStruct,), {"typename": name}, lambda into: into.update(body)))

    return declare


@message("builtin_interfaces")
class Time:
    sec: int32
    nanosec: uint32


@message("builtin_interfaces")
class Duration:
    sec: int32
    nanosec: uint32


@message("std_msgs")
class Header:
    stamp: Time
    frame_id: str


@message("geometry_msgs")
class Point:
    x: float64
    y: float64
    z: float64


@message("geometry_msgs")
class Vector3:
    x: float64
    y: float64
    z: float64


@message("geometry_msgs")
class Quaternion:
    x: float64
    y: float64
    z: float64
    w: float64


@message("geometry_msgs")
class Pose:
    position: Point
    orientation: Quaternion


@message("geometry_msgs")
class PoseWithCovariance:
    pose: Pose
    covariance: array[float64, 36]


@message("geometry_msgs")
class Transform:
    translation: Vector3
    rotation: Quaternion


@message("geometry_msgs")
class TransformStamped:
    header: Header
    child_frame_id: str
    transform: Transform


@message("tf2_msgs")
class TFMessage:
    transforms: sequence[TransformStamped]


@message("sensor_msgs")
class Image:
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@message("sensor_msgs")
class RegionOfInterest:
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@message("sensor_msgs")
class CameraInfo:
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


@message("sensor_msgs")
class PointField:
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@message("sensor_msgs")
class PointCloud2:
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


@message("sensor_msgs")
class CompressedImage:
    header: Header
    format: str
    data: sequence[uint8]


@message("vision_msgs")
class ObjectHypothesis:
    class_id: str
    score: float64


@message("vision_msgs")
class ObjectHypothesisWithPose:
    hypothesis: ObjectHypothesis
    pose: PoseWithCovariance


@message("vision_msgs")
class BoundingBox3D:
    center: Pose
    size: Vector3


@message("vision_msgs")
class Detection3D:
    header: Header
    results: sequence[ObjectHypothesisWithPose]
    bbox: BoundingBox3D
    id: str


@message("vision_msgs")
class Detection3DArray:
    header: Header
    detections: sequence[Detection3D]


@message("vision_msgs")
class VisionClass:
    class_id: uint16
    class_name: str


@message("vision_msgs")
class LabelInfo:
    header: Header
    class_map: sequence[VisionClass]
    threshold: float32


@message("std_msgs")
class ColorRGBA:
    r: float32
    g: float32
    b: float32
    a: float32


@message("visualization_msgs")
class UVCoordinate:
    u: float32
    v: float32


@message("visualization_msgs")
class MeshFile:
    filename: str
    data: sequence[uint8]


@message("visualization_msgs")
class Marker:
    header: Header
    ns: str
    id: int32
    type: int32
    action: int32
    pose: Pose
    scale: Vector3
    color: ColorRGBA
    lifetime: Duration
    frame_locked: bool
    points: sequence[Point]
    colors: sequence[ColorRGBA]
    texture_resource: str
    texture: CompressedImage
    uv_coordinates: sequence[UVCoordinate]
    text: str
    mesh_resource: str
    mesh_file: MeshFile
    mesh_use_embedded_materials: bool


@message("visualization_msgs")
class MarkerArray:
    markers: sequence[Marker]


@message("diagnostic_msgs")
class KeyValue:
    key: str
    value: str


@message("diagnostic_msgs")
class DiagnosticStatus:
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@message("diagnostic_msgs")
class DiagnosticArray:
    header: Header
    status: sequence[DiagnosticStatus]
