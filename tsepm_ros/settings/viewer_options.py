"""Parameters of the node `track_viewer`."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter

MIN_TOKEN_LENGTH = 16


@dataclass(frozen=True, kw_only=True)
class ViewerNodeOptions:
    """Options of the node `track_viewer` and of `tsepm watch`."""

    host: str = parameter(
        "127.0.0.1",
        "Address or name on which the page is served; 0.0.0.0: on all addresses. Browsers need a "
        "token if other machines can reach the address",
        read_only=True,
    )
    port: int = parameter(
        8470, "Port of the page; 0: any free port", minimum=0, maximum=65_535, read_only=True
    )
    token: str = parameter(
        "",
        "Token that browsers must give, at least 16 characters; empty: a new one at each start, "
        "and none if only this machine can reach the page",
        read_only=True,
    )
    kept_scans: int = parameter(
        300,
        "Maximum number of past scans that a browser receives when it connects",
        minimum=1,
        maximum=10_000,
        read_only=True,
    )

    def __post_init__(self) -> None:
        check_group(self)
        if not self.host:
            raise ValueError("host must not be empty; use 0.0.0.0 for all addresses")
        if self.token and len(self.token) < MIN_TOKEN_LENGTH:
            raise ValueError(
                f"token must have at least {MIN_TOKEN_LENGTH} characters, or be empty; "
                f"got {len(self.token)}"
            )
        if not self.token.isascii():
            raise ValueError("token must be of ASCII characters")
