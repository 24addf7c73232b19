"""gRPC channel to NI's device server on which every call has a deadline: `nidaqmx` sets none."""

import os
from typing import Any

os.environ.setdefault("GRPC_VERBOSITY", "ERROR")  # a lost connection is reported by this program, not by gRPC's own log

import grpc

from drivers.deadlines import Deadline

REPLY_MARGIN_S = 1.0
"""Beyond the time for which a call tells NI's driver to wait for samples."""

OPTIONS = [
    # The default limit of 4 MB is half a million samples: one late read would exceed it.
    ("grpc.max_receive_message_length", -1),
    # Channels of one process share a connection and its back-off after a failure: a second without access.
    ("grpc.use_local_subchannel_pool", 1),
]


class DeadlineInterceptor(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc,unused-ignore]
    """Gives every call a deadline. After one that has passed, all others fail at once: the server is not there.

    gRPC's own keep-alive messages are not used: a server ends a connection with too many of them, and a call is over sooner.
    """

    def __init__(self) -> None:
        self.silent: Any = None
        """The first call whose deadline passed; None as long as the server answers."""

    def intercept_unary_unary(self, continuation: Any, client_call_details: Any, request: Any) -> Any:
        if self.silent is not None:
            return self.silent
        seconds = max(Deadline.CARD_SERVER.seconds, getattr(request, "timeout", 0.0) + REPLY_MARGIN_S)
        call = continuation(client_call_details._replace(timeout=seconds), request)
        if call.code() is grpc.StatusCode.DEADLINE_EXCEEDED:
            self.silent = call
        return call


def open_channel(server: str) -> tuple[Any, DeadlineInterceptor]:
    """Return a channel to a server, `host:port`, and the monitor of its answers. Nothing is sent yet."""
    interceptor = DeadlineInterceptor()
    return grpc.intercept_channel(grpc.insecure_channel(server, options=OPTIONS), interceptor), interceptor
