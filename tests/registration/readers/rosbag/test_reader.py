"""Bags written by rosbags: both storages, all message kinds, and what may be wrong with a recording."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from sweeps import assert_same_sweep, known_sweep, world_T_ee

from registration import transforms
from registration.errors import InputError
from registration.readers.plus.calibration_file import calibration_yaml
from registration.readers.rosbag.reader import RosbagReader
from registration.readers.rosbag.writer import write_bag
from registration.synchronisation import AFTER_LAST_POSE, synchronise

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")
STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
READER = RosbagReader(image_topic="/us/image", pose_topic="/robot/ee_pose")
PICTURE = np.random.default_rng(3).integers(0, 256, (6, 9)).astype(np.uint8)
Message = tuple[str, str, float, Any]


def make(name: str, **fields: Any) -> Any:
    return STORE.types[name](**fields)


def header(time_s: float, frame_id: str) -> Any:
    ns = round(time_s * 1e9)
    stamp = make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def image(time_s: float, pixels: np.ndarray = PICTURE, encoding: str = "mono8", padding: int = 0) -> Message:
    rows = np.pad(pixels.reshape(len(pixels), -1), ((0, 0), (0, padding)), constant_values=99)
    message = make(
        "sensor_msgs/msg/Image",
        header=header(time_s, "image"),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.reshape(-1),
    )
    return "/us/image", "sensor_msgs/msg/Image", time_s, message


def compressed(time_s: float, kind: str) -> Message:
    stream = io.BytesIO()
    Image.fromarray(np.full((6, 9), 120, np.uint8) if kind == "jpeg" else PICTURE).save(stream, kind)
    data = np.frombuffer(stream.getvalue(), np.uint8)
    name = "sensor_msgs/msg/CompressedImage"
    return "/us/image", name, time_s, make(name, header=header(time_s, "image"), format=kind, data=data)


def vector(pose: np.ndarray, name: str) -> Any:
    return make(name, **dict(zip("xyz", map(float, pose[:3, 3] / 1000), strict=True)))


def turn(pose: np.ndarray) -> Any:
    values = map(float, Rotation.from_matrix(pose[:3, :3]).as_quat())
    return make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", values, strict=True)))


def pose(time_s: float, frame_id: str = "world") -> Message:
    matrix = world_T_ee(np.array([time_s]))[0]
    name = "geometry_msgs/msg/PoseStamped"
    inner = make(
        "geometry_msgs/msg/Pose", position=vector(matrix, "geometry_msgs/msg/Point"), orientation=turn(matrix)
    )
    return "/robot/ee_pose", name, time_s, make(name, header=header(time_s, frame_id), pose=inner)


def transform(time_s: float, matrix: np.ndarray, parent: str, child: str) -> Any:
    inner = make(
        "geometry_msgs/msg/Transform",
        translation=vector(matrix, "geometry_msgs/msg/Vector3"),
        rotation=turn(matrix),
    )
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=header(time_s, parent),
        child_frame_id=child,
        transform=inner,
    )


def tf(time_s: float, *links: Any, topic: str = "/tf") -> Message:
    return topic, "tf2_msgs/msg/TFMessage", time_s, make("tf2_msgs/msg/TFMessage", transforms=list(links))


@pytest.fixture
def bag(tmp_path: Path) -> Callable[..., Path]:
    """Write messages into a bag in the order given, a microsecond apart."""

    def write(*messages: Message, plugin: str = "SQLITE3") -> Path:
        path = tmp_path / "bag"
        with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
            connections: dict[str, Any] = {}
            for index, (topic, name, _, message) in enumerate(messages):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=STORE)
                writer.write(connections[topic], index * 1000, STORE.serialize_cdr(message, name))
        (path / "calibration.yaml").write_text(calibration_yaml(known_sweep().calibration))
        return path

    return write


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_written_sweep_comes_back_whole(tmp_path: Path, storage: str) -> None:
    write_bag(tmp_path / "bag", known_sweep(), storage)
    assert len(list((tmp_path / "bag").glob("*.db3" if storage == "sqlite3" else "*.mcap"))) == 1
    assert_same_sweep(READER(tmp_path / "bag"), known_sweep())
    file = next(path for path in (tmp_path / "bag").iterdir() if path.suffix in (".db3", ".mcap"))
    assert_same_sweep(READER(file), known_sweep())


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_metres_become_millimetres(bag: Callable[..., Path], plugin: str) -> None:
    sweep = READER(bag(image(0.5), pose(0.4), pose(0.6), plugin=plugin))
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(np.array([0.4, 0.6])), atol=1e-9)
    np.testing.assert_array_equal(sweep.images[0], PICTURE)


def test_encodings_and_padded_rows(bag: Callable[..., Path]) -> None:
    rgb = np.random.default_rng(4).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    grey = np.rint(rgb @ np.array([0.299, 0.587, 0.114])).astype(np.uint8)
    alpha = np.dstack([rgb, np.full((6, 9), 17, np.uint8)])
    sweep = READER(
        bag(
            image(0.1, rgb, "rgb8"),
            image(0.2, rgb[..., ::-1], "bgr8", padding=5),
            image(0.3, alpha, "rgba8"),
            image(0.4, alpha[..., [2, 1, 0, 3]], "bgra8"),
            image(0.5, PICTURE, "8UC1", padding=3),
            pose(0.0),
            pose(1.0),
        )
    )
    for index in range(4):
        np.testing.assert_array_equal(sweep.images[index], grey)
    np.testing.assert_array_equal(sweep.images[4], PICTURE)


def test_compressed_images(bag: Callable[..., Path]) -> None:
    sweep = READER(bag(compressed(0.1, "png"), compressed(0.2, "jpeg"), pose(0.0), pose(1.0)))
    np.testing.assert_array_equal(sweep.images[0], PICTURE)
    assert np.abs(sweep.images[1].astype(int) - 120).max() <= 1


def test_transform_topic(bag: Callable[..., Path]) -> None:
    name = "geometry_msgs/msg/TransformStamped"
    messages = [
        (
            "/robot/ee_pose",
            name,
            time_s,
            transform(time_s, world_T_ee(np.array([time_s]))[0], "world", "flange"),
        )
        for time_s in (0.0, 1.0)
    ]
    path = bag(image(0.5), *messages)
    np.testing.assert_allclose(READER(path).world_T_ee, world_T_ee(np.array([0.0, 1.0])), atol=1e-9)
    other = RosbagReader("/us/image", "/robot/ee_pose", ee="gripper")
    with pytest.raises(InputError, match="message 0: expected ee 'gripper', found frame 'flange'"):
        other(path)


def test_tf2_chain_with_links_of_their_own_times(bag: Callable[..., Path]) -> None:
    base_T_ee, world_T_base = world_T_ee, world_T_ee(np.array([9.0]))[0]
    static = tf(0.0, transform(0.0, np.linalg.inv(world_T_base), "base", "world"), topic="/tf_static")
    arm_s, hand_s = np.arange(0.0, 0.61, 0.1), np.arange(0.03, 0.6, 0.04)
    arm = [tf(t, transform(t, transforms.translation((0.0, 100 * t, 0.0)), "base", "arm")) for t in arm_s]
    hand = []
    for time_s in hand_s:
        arm_T_base = transforms.translation((0.0, -100 * time_s, 0.0))
        hand.append(tf(time_s, transform(time_s, arm_T_base @ base_T_ee(np.array([time_s]))[0], "arm", "ee")))
    path = bag(image(0.3), static, *sorted(arm + hand, key=lambda message: message[2]))
    sweep = RosbagReader("/us/image", world="world", ee="ee", tf_max_gap_s=0.15)(path)
    np.testing.assert_allclose(sweep.pose_times_s, hand_s, atol=1e-9)
    np.testing.assert_allclose(sweep.world_T_ee, world_T_base @ base_T_ee(hand_s), atol=1e-7)
    with pytest.raises(InputError, match="transform eeToroom: expected a chain of known transforms"):
        RosbagReader("/us/image", world="room", ee="ee")(path)


def test_gap_in_one_link_is_a_gap_of_the_poses(bag: Callable[..., Path]) -> None:
    step = transforms.translation((1.0, 0.0, 0.0))
    arm = [tf(t, transform(t, step, "world", "arm")) for t in (0.0, 0.1, 0.7, 0.8)]
    hand = [
        tf(t, transform(t, world_T_ee(np.array([t]))[0], "arm", "ee")) for t in np.arange(0.0, 0.81, 0.05)
    ]
    path = bag(image(0.05), image(0.4), *sorted(arm + hand, key=lambda message: message[2]))
    sweep = RosbagReader("/us/image", world="world", ee="ee", tf_max_gap_s=0.2)(path)
    assert not ((sweep.pose_times_s > 0.11) & (sweep.pose_times_s < 0.69)).any()
    assert synchronise(sweep, 0.2).kept.tolist() == [0]


def test_out_of_order_poses_are_refused_or_sorted(bag: Callable[..., Path]) -> None:
    path = bag(image(0.2), pose(0.0), pose(0.3), pose(0.1), pose(0.4))
    with pytest.raises(InputError, match=r"/robot/ee_pose: expected poses in the order of their times"):
        READER(path)
    sweep = RosbagReader("/us/image", "/robot/ee_pose", out_of_order="sort")(path)
    np.testing.assert_allclose(sweep.pose_times_s, [0.0, 0.1, 0.3, 0.4])
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(np.array([0.0, 0.1, 0.3, 0.4])), atol=1e-9)


def test_out_of_order_images_are_refused_or_sorted(bag: Callable[..., Path]) -> None:
    path = bag(image(0.3), image(0.2, 255 - PICTURE), pose(0.0), pose(1.0))
    with pytest.raises(InputError, match=r"images of /us/image in the order .*out_of_order=sort"):
        READER(path)
    sweep = RosbagReader("/us/image", "/robot/ee_pose", out_of_order="sort")(path)
    np.testing.assert_array_equal(sweep.images[0], 255 - PICTURE)


def test_missing_poses_drop_frames_and_are_counted(bag: Callable[..., Path]) -> None:
    times = [0.0, 0.1, 0.2, 0.6, 0.7]
    sweep = READER(bag(*(image(t + 0.05) for t in (0.0, 0.1, 0.4, 0.6, 0.7)), *(pose(t) for t in times)))
    posed = synchronise(sweep, max_gap_s=0.15)
    assert posed.kept.tolist() == [0, 1, 3]
    assert posed.dropped == {AFTER_LAST_POSE: 1, "in a gap between poses longer than max_gap_s": 1}


@pytest.mark.parametrize(
    ("messages", "message"),
    [
        ([pose(0.0), pose(1.0)], r"expected the topic /us/image, found /robot/ee_pose \(geometry_msgs"),
        ([image(0.0)], "expected the topic /robot/ee_pose, found /us/image"),
        ([image(0.0), ("/robot/ee_pose", *image(0.1)[1:])], "expected geometry_msgs/msg/PoseStamped or"),
        (
            [image(0.0), image(0.1, PICTURE[:4]), pose(0.0)],
            r"message 1: expected the first image's size \(6, 9\)",
        ),
        ([image(0.0, PICTURE, "bayer_rggb8"), pose(0.0)], "message 0: expected an encoding of mono8"),
    ],
)
def test_unfitting_bags_are_refused(bag: Callable[..., Path], messages: list[Message], message: str) -> None:
    with pytest.raises(InputError, match=message):
        READER(bag(*messages))


def test_pose_in_another_frame_is_refused(bag: Callable[..., Path]) -> None:
    path = bag(image(0.0), pose(0.0, "camera"), pose(1.0, "camera"))
    with pytest.raises(InputError, match="expected world 'world', found frame 'camera'"):
        RosbagReader("/us/image", "/robot/ee_pose", world="world")(path)


def broken_pose(time_s: float, length: float = 0.0) -> Message:
    message = pose(time_s)
    for axis in "xyzw":
        setattr(message[3].pose.orientation, axis, length * getattr(message[3].pose.orientation, axis))
    return message


def test_poses_without_a_rotation_are_left_out_and_counted(bag: Callable[..., Path]) -> None:
    times = np.arange(0.0, 1.01, 0.1)
    poses = [broken_pose(t) if index in (0, 4) else broken_pose(t, 1.003) for index, t in enumerate(times)]
    sweep = READER(bag(image(0.35), image(0.4), *poses))
    kept = np.delete(times, [0, 4])
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(kept), atol=1e-9)
    assert sweep.dropped == {"pose: message without a valid value": 2}
    assert sweep.frames_dropped == 0
    # The frame at the pose that was left out is in a gap.
    assert synchronise(sweep, max_gap_s=0.15).kept.tolist() == []


def test_a_position_beyond_all_numbers_in_mm_is_refused_with_the_bags_name(bag: Callable[..., Path]) -> None:
    far = pose(0.0)
    far[3].pose.position.x = 1e306  # metres
    with pytest.raises(InputError, match=r"bag: world_T_ee: expected finite entries"):
        READER(bag(image(0.0), far, pose(1.0)))


def test_only_broken_poses_are_refused(bag: Callable[..., Path]) -> None:
    path = bag(image(0.0), broken_pose(0.0), broken_pose(1.0, 1.02))
    expected = (
        "ee_pose: expected valid messages, found 2 broken ones: .*message 0: expected a finite position"
    )
    with pytest.raises(InputError, match=expected):
        READER(path)


def test_broken_pictures_are_left_out_and_counted(bag: Callable[..., Path]) -> None:
    cut = compressed(0.2, "png")
    cut[3].data = cut[3].data[:40]
    sweep = READER(bag(compressed(0.1, "png"), cut, compressed(0.3, "png"), pose(0.0), pose(1.0)))
    np.testing.assert_allclose(sweep.image_times_s, [0.1, 0.3])
    assert sweep.dropped == {"image: message without a valid value": 1}
    assert sweep.frames_dropped == 1


def test_broken_links_of_the_chain_are_counted_and_others_do_not_matter(bag: Callable[..., Path]) -> None:
    times = np.arange(0.0, 1.01, 0.1)
    hand = []
    for index, time_s in enumerate(times):
        link = transform(time_s, world_T_ee(np.array([time_s]))[0], "world", "ee")
        if index == 3:
            link.transform.rotation.w = float("nan")
        gripper = transform(time_s, np.eye(4), "ee", "gripper")
        gripper.transform.rotation.w = 0.0
        hand.append(tf(time_s, gripper, link))
    static = transform(0.0, np.eye(4), "world", "table")
    static.transform.translation.x = float("inf")
    path = bag(image(0.5), tf(0.0, static, topic="/tf_static"), *hand)
    sweep = RosbagReader("/us/image", world="world", ee="ee", tf_max_gap_s=0.15)(path)
    kept = np.delete(times, 3)
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(kept), atol=1e-9)
    assert sweep.dropped == {"pose: ee to world without a valid transform": 1}
    with pytest.raises(InputError, match=r"gripper.*; without a valid transform: .*gripper to ee"):
        RosbagReader("/us/image", world="world", ee="gripper")(path)


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("given", ["file", "folder"])
def test_a_bag_without_metadata(bag: Callable[..., Path], plugin: str, given: str) -> None:
    folder = bag(image(0.5), pose(0.4), pose(0.6), plugin=plugin)
    (folder / "metadata.yaml").unlink()
    file = next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    (folder / f"._{file.name}").write_bytes(b"of the system's own")
    sweep = READER(file if given == "file" else folder)
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(np.array([0.4, 0.6])), atol=1e-9)
    np.testing.assert_array_equal(sweep.images[0], PICTURE)


def test_a_file_that_the_metadata_beside_it_does_not_name_is_read_alone(bag: Callable[..., Path]) -> None:
    folder = bag(image(0.5), pose(0.4), pose(0.6), plugin="MCAP")
    own = folder / "other.mcap"
    own.write_bytes(next(folder.glob("bag*.mcap")).read_bytes())
    next(folder.glob("bag*.mcap")).unlink()
    assert len(READER(own).images) == 1


def test_several_files_without_metadata_are_refused(bag: Callable[..., Path]) -> None:
    folder = bag(image(0.5), pose(0.4), pose(0.6), plugin="MCAP")
    (folder / "metadata.yaml").unlink()
    (folder / "second.mcap").write_bytes(b"")
    with pytest.raises(InputError, match=r"expected a ROS 2 bag .*, found 2 files of bags without it"):
        READER(folder)


def unstamped(*messages: Message) -> list[Message]:
    for _, name, _, message in messages:
        for one in message.transforms if name.endswith("TFMessage") else [message]:
            one.header.stamp.sec = one.header.stamp.nanosec = 0
    return list(messages)


def test_headers_without_times(bag: Callable[..., Path]) -> None:
    """Messages are recorded a microsecond apart by the fixture."""
    path = bag(*unstamped(pose(0.0), image(0.1), pose(0.2), image(0.3), pose(0.4)))
    with pytest.raises(InputError, match=r"/us/image: expected times .*, found 0 in all 2 .*times=recorded"):
        READER(path)
    sweep = RosbagReader("/us/image", "/robot/ee_pose", times="recorded")(path)
    np.testing.assert_allclose(sweep.image_times_s, [1e-6, 3e-6])
    np.testing.assert_allclose(sweep.pose_times_s, [0, 2e-6, 4e-6])


def test_poses_alone_without_times_are_refused(bag: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match=r"ee_pose: expected times in the headers, found 0 in all 2"):
        READER(bag(image(0.1), *unstamped(pose(0.0), pose(0.2))))


def test_tf_without_times(bag: Callable[..., Path]) -> None:
    links = [tf(t, transform(t, world_T_ee(np.array([t]))[0], "world", "ee")) for t in (0.0, 0.1, 0.2)]
    path = bag(*unstamped(links[0], image(0.1), links[1], links[2]))
    chain = RosbagReader("/us/image", world="world", ee="ee")
    with pytest.raises(InputError, match="ee to world: expected times in the headers, found 0 in all 3"):
        chain(path)
    sweep = replace(chain, times="recorded")(path)
    np.testing.assert_allclose(sweep.pose_times_s, [0, 2e-6, 3e-6])


def test_first_messages_without_a_time_are_left_out(bag: Callable[..., Path]) -> None:
    start = 1.7e9
    poses = [pose(start + t) for t in (0.0, 0.1, 0.2)]
    path = bag(*unstamped(pose(0.5), image(0.5)), image(start + 0.1), *poses)
    sweep = READER(path)
    assert len(sweep.pose_times_s) == 3
    assert sweep.image_times_s.tolist() == [start + 0.1]
    assert sweep.dropped == {
        "image: message without a header time": 1,
        "pose: message without a header time": 1,
    }


def test_a_clock_that_began_at_0_is_one(bag: Callable[..., Path]) -> None:
    assert READER(bag(image(0.0), image(0.5), pose(0.0), pose(1.0))).image_times_s.tolist() == [0.0, 0.5]


def in_millimetres(message: Message) -> Message:
    for axis in "xyz":
        place = message[3].pose.position
        setattr(place, axis, 1000 * getattr(place, axis))
    return message


def test_millimetres_are_refused_unless_they_are_said(bag: Callable[..., Path]) -> None:
    times = np.arange(0.0, 2.0, 0.1)
    path = bag(image(0.5), *(in_millimetres(pose(t)) for t in times))
    with pytest.raises(InputError, match=r"bag: expected positions in m that span at most 3 m, .*units=mm"):
        READER(path)
    sweep = RosbagReader("/us/image", "/robot/ee_pose", units="mm")(path)
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(times), atol=1e-9)
    far = RosbagReader("/us/image", "/robot/ee_pose", units="m")(path)
    np.testing.assert_allclose(far.world_T_ee[:, :3, 3], 1000 * world_T_ee(times)[:, :3, 3])


@pytest.mark.parametrize("kind", ["mono16", "png"])
def test_16_bits_are_scaled_from_full_scale(bag: Callable[..., Path], kind: str) -> None:
    wide = PICTURE.astype(np.uint16) * 257
    wide[0, 0] = 65535
    if kind == "mono16":
        message = image(0.1, wide.view(np.uint8).reshape(6, -1), "mono16", padding=4)
        message[3].width = 9
    else:
        stream = io.BytesIO()
        Image.fromarray(wide).save(stream, "png")
        message = compressed(0.2, "png")
        message[3].data = np.frombuffer(stream.getvalue(), np.uint8)
    expected = PICTURE.copy()
    expected[0, 0] = 255
    np.testing.assert_array_equal(READER(bag(message, pose(0.0), pose(1.0))).images, [expected])


def test_12_bits_in_16_are_refused(bag: Callable[..., Path]) -> None:
    wide = PICTURE.astype(np.uint16) * 16
    raw = image(0.1, wide.view(np.uint8).reshape(6, -1), "mono16")
    raw[3].width = 9
    with pytest.raises(
        InputError, match=r"/us/image: expected pixels of 8 bits, or of 16 bits that use their full"
    ):
        READER(bag(raw, pose(0.0), pose(1.0)))


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_truncated_bag_is_refused(tmp_path: Path, storage: str) -> None:
    write_bag(tmp_path / "bag", known_sweep(), storage)
    file = next(path for path in (tmp_path / "bag").iterdir() if path.suffix in (".db3", ".mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(
        InputError, match=r"bag: expected a readable ROS 2 bag, received a file that can't be read as one"
    ):
        READER(tmp_path / "bag")


def test_what_is_no_bag_and_what_lacks_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a ROS 2 bag"):
        READER(tmp_path)
    write_bag(tmp_path / "bag", known_sweep())
    (tmp_path / "bag" / "calibration.yaml").unlink()
    with pytest.raises(InputError, match=r"calibration\.yaml: expected a file, received nothing there"):
        READER(tmp_path / "bag")


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"image_topic": "/i"}, "pose_topic"),
        ({"image_topic": "/i", "world": "w"}, "pose_topic"),
        ({"image_topic": "/i", "pose_topic": "/p", "out_of_order": "guess"}, "out_of_order"),
        ({"image_topic": "/i", "pose_topic": "/p", "tf_max_gap_s": 0.0}, "tf_max_gap_s"),
        ({"image_topic": "/i", "pose_topic": "/p", "times": "guess"}, "times"),
        ({"image_topic": "/i", "pose_topic": "/p", "units": "cm"}, "units"),
    ],
)
def test_settings_are_checked(settings: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        RosbagReader(**settings)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_times_before_zero_come_back(tmp_path: Path, storage: str) -> None:
    sweep = known_sweep()
    early = replace(sweep, image_times_s=sweep.image_times_s - 0.8, pose_times_s=sweep.pose_times_s - 0.8)
    write_bag(tmp_path / "bag", early, storage)
    assert_same_sweep(READER(tmp_path / "bag"), early)


def test_what_a_bag_cannot_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="storage: expected sqlite3 or mcap, received 'zip'"):
        write_bag(tmp_path / "bag", known_sweep(), "zip")
    late = replace(known_sweep(), image_times_s=known_sweep().image_times_s + 2.0**31)
    with pytest.raises(InputError, match="expected times below 2147483648 s"):
        write_bag(tmp_path / "bag", late)
    assert not (tmp_path / "bag").exists()
