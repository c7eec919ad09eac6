"""Messages between two processes of this machine: vectors by name, as JSON."""

import json
import os
import secrets
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client, Connection, Listener
from typing import Any, Final

_HOST: Final = "127.0.0.1"
_MOST: Final = 1 << 28  # bytes of a message
_ENDING: Final = 5.0  # s, for a process to end
_STARTING: Final = 60.0  # s, for a process to begin
_FAILED: Final = "failed"

Message = Mapping[str, Any]


class LinkError(RuntimeError):
    """The other side has ended, has failed, or does not answer."""


class Link:
    """One end of a connection."""

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self._connection = connection
        with socket.socket(fileno=os.dup(connection.fileno())) as one:
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, message: Message) -> None:
        """Send vectors by name."""
        try:
            self._connection.send_bytes(json.dumps(message).encode())
        except OSError as error:
            raise LinkError("has ended") from error

    def fail(self, reason: str) -> None:
        """Send the reason of this side's end."""
        self.send({_FAILED: reason})

    def receive(self, timeout: float | None) -> Message | None:
        """Return the next message; None if none comes for a time, s; None waits indefinitely.

        Raises:
            LinkError: If the other side has ended or failed.
        """
        try:
            if not self._connection.poll(timeout):
                return None
            message: Message = json.loads(self._connection.recv_bytes(_MOST))
        except (EOFError, OSError) as error:
            raise LinkError("has ended") from error
        if _FAILED in message:
            raise LinkError(f"has failed: {message[_FAILED]}")
        return message


@contextmanager
def process(module: str, order: Message) -> Iterator[Link]:
    """Run a module in another process, and yield the connection to it; it ends with the block.

    The module calls :func:`served` for its end and its order. It has its own session, so
    that Ctrl-C reaches only its starter, which ends it.

    Raises:
        LinkError: If it does not start.
    """
    key, pipe = secrets.token_hex(), subprocess.PIPE
    command = [sys.executable, "-m", module]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, start_new_session=True) as child:
        try:
            assert child.stdin is not None
            assert child.stdout is not None
            try:
                child.stdin.write(json.dumps({**order, "key": key}).encode() + b"\n")
                child.stdin.flush()
                if not select.select([child.stdout], [], [], _STARTING)[0]:
                    raise LinkError(f"does not begin for {_STARTING:g} s")
                connection = Client((_HOST, int(child.stdout.readline())), authkey=key.encode())
            except (ValueError, OSError) as error:
                raise LinkError("has ended before it began") from error
            with connection:
                yield Link(connection)
        finally:
            try:
                child.wait(_ENDING)
            except subprocess.TimeoutExpired:
                child.kill()


def served() -> tuple[Message, Link]:
    """Return the order of this process, and its end of the connection to its starter.

    It listens on this machine alone, refuses connections without the key, and ends with its
    starter.
    """
    order = json.loads(sys.stdin.readline())

    def end_with_starter() -> None:
        sys.stdin.read()
        os._exit(1)

    threading.Thread(target=end_with_starter, daemon=True).start()
    with Listener((_HOST, 0), authkey=order["key"].encode()) as listener:
        print(listener.address[1], flush=True)
        while True:
            try:
                return order, Link(listener.accept())
            except (AuthenticationError, EOFError, OSError):
                continue  # somebody else
