"""One window of the viewer: its scene, its question, and what is drawn."""

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.geometry import Array, Camera
from egosplat.query.things import Thing
from egosplat.viewer.painting import Painter
from egosplat.viewer.panel import FIT, NO_SCENE, NO_WORD, OWN, build_panel
from egosplat.viewer.pictures import draw
from egosplat.viewer.questions import Reply
from egosplat.viewer.recording import add_cameras, hide_near, photograph
from egosplat.viewer.renderer import Renderer
from egosplat.viewer.splats import add_splats
from egosplat.viewer.wording import OUTSIDE, WAITING, named_text, plain, reply_text, scene_text
from egosplat.viewer.world import World

if TYPE_CHECKING:
    from viser import ClientHandle

# Time without a key after which a text is taken as a question [s].
TYPING_S = 0.2

# Distance from which an answer is looked at, relative to the diagonal of its box; at least this share of the reach.
STEP_BACK, NEAREST = 1.6, 0.25


class Session:
    """The state of one window. Its methods may be called from any thread."""

    def __init__(self, client: "ClientHandle", worlds: Sequence[World]) -> None:
        self._client, self._worlds = client, {world.name: world for world in worlds}
        self._lock = threading.RLock()
        self._world, self._other = worlds[0], None
        self._phrase, self._thing, self._timer = "", 0, None
        # The frame of the last jump, whose slider must not move the view.
        self._jumped_to: int | None = None
        self._replies: dict[str, Reply] = {}
        self._marks: list[Any] = []
        self._cameras: dict[int, Any] = {}
        self._splats: Any = None
        viewed = self._world.viewed
        self._panel = build_panel(
            client, list(self._worlds), len(viewed.camera_to_world), viewed.masks is not None
        )
        self._painter = Painter(self._panel.ask)
        self._renderer = Renderer(client, self._draw)
        self._show_world()
        self._panel.frames.frame.value = self._world.first_frame
        self._show_photograph()
        self._prepare_marks()
        self._connect()
        self._renderer.start()
        self._renderer.camera_moved()

    def close(self) -> None:
        """End the window's thread."""
        self._renderer.stop()

    def questions_ready(self, world: World) -> None:
        """Take note that a scene's questions are ready, or why there are none."""
        with self._lock:
            if world is self._world:
                self._show_world()
            if self._phrase:
                self._ask(self._phrase)

    def _connect(self) -> None:
        """Connect the controls with what they do."""
        ask, frames, scene = self._panel.ask, self._panel.frames, self._panel.scene
        on = self._on
        self._client.camera.on_update(lambda _: self._renderer.camera_moved())
        on(ask.query, lambda: self._typed(ask.query.value))
        on(ask.suggestions, self._suggested)
        for control in (ask.colors, ask.level, ask.threshold, ask.only):
            on(control, self._repaint)
        ask.jump.on_click(lambda _: self._jump())
        on(frames.frame, self._go_to_frame)
        on(frames.follow, self._go_to_frame)
        on(frames.tint, self._show_photograph)
        for control in (frames.cameras, frames.thumbnails):
            on(control, self._show_cameras)
        on(scene.browser, self._repaint)
        if scene.scene is not None:
            on(scene.scene, lambda: self._change_scene(scene.scene.value))
            on(scene.compare, self._compare)
        self._client.scene.on_click()(
            lambda event: self._clicked(np.array(event.ray_origin), np.array(event.ray_direction))
        )

    def _on(self, control: Any, act: Callable[[], None]) -> None:
        def update(_: object) -> None:
            with self._lock:
                act()

        control.on_update(update)

    def _show_world(self) -> None:
        """Fit the controls to the scene."""
        world, questions = self._world, self._world.questions
        levels = questions.levels if questions else ()
        words = questions.words if questions else ()
        threshold = questions.options.min_score if questions else None
        self._panel.show_scene(levels, world.instance_levels, words, threshold)
        self._panel.ask.answer.content = plain(world.silence or WAITING)
        notice = questions.notice if questions else None
        self._panel.scene.about.content = scene_text(world.viewed, world.silence, notice)

    def _typed(self, phrase: str) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(TYPING_S, self._ask, [phrase.strip()])
        self._timer.daemon = True
        self._timer.start()

    def _suggested(self) -> None:
        word = self._panel.ask.suggestions.value
        if word != NO_WORD:
            self._panel.ask.query.value = word

    def _ask(self, phrase: str) -> None:
        """Answer a question in all scenes that are shown."""
        with self._lock:
            self._phrase, self._thing = phrase, 0
            self._replies.clear()
            told = plain(WAITING)
            for world in filter(None, (self._other, self._world)):
                told = self._answer(world, phrase) if phrase else told
            found = self._found()
            if found and not self._in_view(found[0].center):
                told += plain(OUTSIDE)
            self._panel.ask.answer.content = told
            self._panel.ask.jump.disabled = not found
            self._panel.ask.colors.value = FIT if found else OWN
            self._mark(found)
            self._repaint()

    def _answer(self, world: World, phrase: str) -> str:
        """Ask one scene; returns what to say."""
        if world.questions is None:
            return plain(world.silence or "")
        try:
            reply = world.questions.ask(phrase)
        except UserError as error:
            return plain(str(error))
        self._replies[world.name] = reply
        return reply_text(reply, world.questions, world.viewed.unit)

    def _found(self) -> tuple[Thing, ...]:
        reply = self._replies.get(self._world.name)
        return reply.things if reply else ()

    def _mark(self, things: Sequence[Thing]) -> None:
        """Mark the centers of things with balls and numbers."""
        for mark in self._marks:
            mark.remove()
        scene, radius = self._client.scene, self._world.viewed.size_of_markers
        self._marks = []
        for number, thing in enumerate(things, 1):
            ball = scene.add_icosphere(
                f"/answers/{number}/ball", radius=radius, color=(230, 30, 60), position=thing.center
            )
            text = f"{number} {self._phrase}" if len(things) > 1 else self._phrase
            label = scene.add_label(f"/answers/{number}/label", text[:40], position=thing.center)
            self._marks += [ball, label]

    def _prepare_marks(self) -> None:
        """Show a mark too small to be seen, until the first answer."""
        # Without a GPU, a browser stops for seconds when it first draws a ball and a label: not while a user waits for an answer.
        pose = self._world.viewed.camera_to_world[self._world.first_frame]
        ahead, scene = self._world.point_ahead(pose), self._client.scene
        radius = 1e-3 * self._world.viewed.size_of_markers
        self._marks = [
            scene.add_icosphere("/answers/0/ball", radius=radius, position=ahead),
            scene.add_label(
                "/answers/0/label", " ", position=ahead, font_size_mode="scene", font_scene_height=radius
            ),
        ]

    def _jump(self) -> None:
        """Look at the answer; the next time at the next one."""
        with self._lock:
            found, questions = self._found(), self._world.questions
            if not found or questions is None:
                return
            thing = found[self._thing % len(found)]
            self._thing += 1
            viewed = self._world.viewed
            frame = questions.best_frame(thing)
            self._show_frame(frame)
            seen_from = viewed.camera_to_world[frame][:3, 3]
            away = seen_from - thing.center
            wanted = max(STEP_BACK * float(np.linalg.norm(thing.high - thing.low)), NEAREST * viewed.reach)
            # Nearer along the line of sight of a frame, where nothing hides the thing; never farther.
            distance = min(wanted, float(np.linalg.norm(away)))
            self.look(thing.center + away / np.linalg.norm(away) * distance, thing.center)

    def look(self, position: Array, target: Array) -> None:
        """Move the window's camera."""
        camera, up = self._client.camera, self._world.viewed.up
        with self._client.atomic():
            camera.up_direction = up
            camera.position = position
            camera.look_at = target
            hide_near(self._cameras, self._world.viewed, position)
        self._client.flush()
        self._renderer.camera_moved()

    def _clicked(self, origin: Array, direction: Array) -> None:
        with self._lock:
            world, questions = self._world, self._world.questions
            if questions is None:
                self._panel.ask.clicked.content = plain(world.silence or "")
                return
            named = questions.name(origin, direction)
            owners = world.instances_at(named.position) if named.position is not None else {}
            told = named_text(named, questions.levels, owners, world.viewed.unit)
            self._panel.ask.clicked.content = told

    def _go_to_frame(self) -> None:
        frame = int(self._panel.frames.frame.value)
        pose = self._world.viewed.camera_to_world[frame]
        has_pose = bool(np.isfinite(pose).all())
        self._panel.frames.told.content = "" if has_pose else plain(f"Frame {frame} has no pose.")
        self._show_photograph()
        follow = self._panel.frames.follow.value and frame != self._jumped_to
        self._jumped_to = None
        if has_pose and follow:
            self._look_from(pose)

    def _show_frame(self, frame: int) -> None:
        """Set the slider and the photograph to a frame; the view stays."""
        if int(self._panel.frames.frame.value) != frame:
            self._jumped_to = frame
            self._panel.frames.frame.value = frame

    def _in_view(self, point: Array) -> bool:
        """Whether the window's camera sees a point, or would without what is in front of it."""
        camera = self._client.camera
        x, y, z = Rotation.from_quat(camera.wxyz, scalar_first=True).inv().apply(point - camera.position)
        half = z * np.tan(camera.fov / 2)
        return bool(z > 0 and abs(y) <= half and abs(x) <= half * camera.aspect)

    def _look_from(self, pose: Array) -> None:
        """Look as a frame does, without its roll."""
        self.look(pose[:3, 3], self._world.point_ahead(pose))

    def _show_photograph(self) -> None:
        frames = self._panel.frames
        frames.picture.image = photograph(self._world.viewed, int(frames.frame.value), frames.tint.value)

    def _show_cameras(self) -> None:
        """Add the frusta, or remove them: a node that is only hidden costs time, too."""
        for camera in self._cameras.values():
            camera.remove()
        self._cameras = {}
        frames = self._panel.frames
        if not (frames.cameras.value or frames.thumbnails.value):
            return
        self._cameras = add_cameras(self._client, self._world.viewed, frames.thumbnails.value)
        for frame, camera in self._cameras.items():
            camera.on_click(lambda _, frame=frame: self._choose_frame(frame))
        hide_near(self._cameras, self._world.viewed, self._client.camera.position)

    def _choose_frame(self, frame: int) -> None:
        # Setting the slider goes there.
        self._panel.frames.frame.value = frame

    def _change_scene(self, name: str) -> None:
        self._world = self._worlds[name]
        viewed = self._world.viewed
        self._show_world()
        self._panel.frames.frame.max = max(1, len(viewed.camera_to_world) - 1)
        frame = self._world.first_frame
        self._panel.frames.frame.value = frame
        self._look_from(viewed.camera_to_world[frame])
        self._show_cameras()
        self._ask(self._phrase)

    def _compare(self) -> None:
        chosen = self._panel.scene.compare.value
        self._other = None if chosen == NO_SCENE else self._worlds[chosen]
        self._ask(self._phrase)

    def _repaint(self) -> None:
        if self._splats is not None:
            self._splats.remove()
            self._splats = None
        if self._panel.scene.browser.value:
            self._client.scene.set_background_image(None)
            self._splats = add_splats(
                self._client, self._painter.paint(self._world, self._replies.get(self._world.name))
            )
        self._renderer.changed()

    def _draw(self, camera: Camera, pose: Array) -> tuple[NDArray[np.uint8], NDArray[np.float32]] | None:
        with self._lock:
            if self._splats is not None:
                return None
            shown = [
                (world.viewed.trained, self._painter.paint(world, self._replies.get(world.name)))
                for world in (self._world, self._other)
                if world
            ]
        drawn = [draw(trained, painted, camera, pose) for trained, painted in shown]
        if len(drawn) == 1:
            return drawn[0]
        middle = camera.width // 2
        image, depth = (
            np.concatenate([left[:, :middle], right[:, middle:]], axis=1)
            for left, right in zip(*drawn, strict=True)
        )
        return image, depth
