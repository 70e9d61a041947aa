"""Start of the server, and the way of live messages to it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from msg_adapters import MessageError
from tsepm_ros.session.drop_reasons import shortened
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer.live_frames import DIAGNOSTICS, OWN_SHIP, LiveFrames
from tsepm_ros.tools.viewer.page_frames import health_of_message
from tsepm_ros.tools.viewer.page_state import PageState

if TYPE_CHECKING:
    from tsepm_ros.tools.viewer.page_server import PageServer


GATHERING_TIME = 0.015
"""Time for the messages of a scan to arrive before the scan is drawn, s."""
MAX_WAITING = 500
"""Messages that wait for the server's thread."""


def make_server(
    options: ViewerNodeOptions,
    title: str,
    state: PageState | None = None,
) -> PageServer:
    """Make a `PageServer`, see there.

    Raises
    ------
    ValueError
        If its library is not installed, or it cannot be bound.
    """
    try:
        from tsepm_ros.tools.viewer.page_server import PageServer
    except ImportError:
        raise ValueError(
            "the page needs the library tornado: pip install tornado, the extra viewer, or the "
            "package python3-tornado"
        ) from None
    return PageServer(options, title, state)


class LiveFeed:
    """Takes messages in one thread, and shows them in the server's.

    Parameters
    ----------
    options : ViewerNodeOptions
    title : str
    topic : str
        Topic of the held tracks, for a page that waits for it.
    report : callable
        Called with a sentence for a message that cannot be read, in the server's thread.
    read_own_ship : callable, optional
        Makes a message of what is received on OWN_SHIP; only the newest is read.

    Raises
    ------
    ValueError
        As in `make_server`.
    """

    def __init__(
        self,
        options: ViewerNodeOptions,
        title: str,
        topic: str,
        report: Callable[[str], None],
        read_own_ship: Callable[[Any], Any] = lambda message: message,
    ) -> None:
        self._report = report
        self._read_own_ship = read_own_ship
        self._frames = LiveFrames(self._report_error)
        self._state = PageState(
            {"kind": "live", "title": title, "topic": topic}, options.kept_scans
        )
        self._waiting: deque[tuple[str, Any]] = deque(maxlen=MAX_WAITING)
        self._own_ship: Any = None
        self._scheduled = False
        self._published: bool | None = None
        self.server = make_server(options, title, self._state)
        self.server.start()

    def take(self, topic: str, message: Any) -> None:
        """Take a message; `topic` is one of those of `tsepm_ros.tools.viewer.live_frames`."""
        if topic == OWN_SHIP:
            self._own_ship = message  # waits for the next scan
            return
        self._waiting.append((topic, message))
        if not self._scheduled:
            self._scheduled = True
            self.server.call_later(GATHERING_TIME, self._show)

    def published(self, known: bool) -> None:
        """Say whether anything publishes held tracks, for a page that waits for them."""
        if known != self._published:
            self._published = known
            self._state.put_info(published=known)

    def watching(self, topic: str) -> None:
        """Say which topic of held tracks is shown."""
        self._state.put_info(title=f"Tracks on {topic}", topic=topic)

    def stop(self) -> None:
        """End the server."""
        self.server.stop()

    def _show(self) -> None:
        """Read what has arrived, in the server's thread."""
        self._scheduled = False
        while self._waiting:
            topic, message = self._waiting.popleft()
            if topic != DIAGNOSTICS:
                self._frames.take(topic, message)
            elif (health := health_of_message(message)) is not None:
                self._state.put_health(health)
        own_ship, self._own_ship = self._own_ship, None
        if own_ship is not None:
            self._frames.take_own_ship(self._read_own_ship(own_ship))
        for frame, facts in self._frames.take_frames():
            self._state.put(frame, facts)

    def _report_error(self, topic: str, error: MessageError) -> None:
        self._report(shortened(f"a message on {topic} cannot be shown: {error}"))
