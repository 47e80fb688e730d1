"""What mypy --strict must accept: the stubs say what the package has."""

import numpy as np
from numpy.typing import NDArray

import beo


def first_percept(path: str) -> str:
    model = beo.Model.load(path)
    grid: NDArray[np.uint8] = beo.view_from_above(beo.household_shape("mug", seed=7, dims=model.dims))
    percept = model.perceive(grid, pose="yaw", yaw_span_deg=180.0)
    if percept.class_name is None or percept.occupancy is None:
        return "nothing"
    solid: int = int((percept.occupancy >= 0.5).sum())
    best: float = max(percept.probabilities.values())
    rotation: NDArray[np.float64] = percept.hypotheses[0].rotation
    return f"{percept.class_name} {best} {solid} {rotation}"


def learn(shapes: NDArray[np.bool_]) -> beo.Model:
    return beo.Model.train({"thing": shapes, "other": [shapes[0], shapes[1]]}, poses=False, progress=print)


def camera(depth: NDArray[np.float32], model: beo.Model) -> None:
    labels: NDArray[np.uint16] = beo.segment(depth, (600.0, 600.0, 319.5, 239.5), up=(0.0, -1.0, 0.0))
    with beo.Observer("left", timeout=1.0) as observer, beo.Subscriber("left", completion=True) as subscriber:
        for grid in beo.carve(depth, np.eye(3), labels, dims=model.dims):
            number: int = observer.observe(grid, continues=True)
            percept = subscriber.take(timeout=2.0)
            if percept is not None and percept.sequence == number:
                print(percept.object_position_m + percept.position_m, percept.status)
        for percept in subscriber:
            print(percept.class_name)
