"""Addresses of the page: the socket of the server, and the links to it."""

import errno
import io
import socket

from pacman_env.web.access import Tokens

_SEND_BUFFER = 1 << 17  # bytes; small, so that a slow reader gets newer frames
_UNREAD_MS = 10_000  # the system disconnects clients that read nothing for this time (Linux only)
#: By the name of all addresses: their family, and an address that is reserved for documentation.
_ALL = {"0.0.0.0": (socket.AF_INET, "192.0.2.1"), "::": (socket.AF_INET6, "2001:db8::1")}


def bind(host: str, port: int) -> socket.socket:
    """Return a socket bound to an address of this machine; raises OSError with the reason."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise OSError(f"{host}: no such address") from error
    try:
        bound = socket.create_server(address, family=family, dualstack_ipv6=family == socket.AF_INET6)
    except OSError as error:
        reasons = {
            errno.EADDRINUSE: f"port {port} of {host} is in use: choose another port, or 0 for any free one",
            errno.EADDRNOTAVAIL: f"{host} is not an address of this computer",
            errno.EACCES: f"port {port} of {host} is not permitted: choose a port from 1024 on, or 0 for any free one",
        }
        raise OSError(reasons.get(error.errno or 0, f"{host}, port {port}: {error.strerror}")) from error
    # Connections inherit these options.
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNREAD_MS)
    return bound


def link(address: str, port: int) -> str:
    shown = shown_address(address)
    return f"http://[{shown}]:{port}/" if ":" in shown else f"http://{shown}:{port}/"


def with_token(url: str, token: str) -> str:
    return f"{url}?token={token}" if token else url


def shown_address(address: str) -> str:
    """Return the address, or by which address other machines reach this one if it is bound to all; sends nothing."""
    if address not in _ALL:
        return address
    family, there = _ALL[address]
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((there, 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()


def qr_code(text: str) -> str:
    """Return a QR code for a terminal, in half blocks; empty if segno is missing."""
    try:
        import segno
    except ImportError:
        return ""
    out = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(out, compact=True, border=2)
    return out.getvalue().rstrip("\n")


def start_text(url: str, tokens: Tokens | None) -> str:
    """Return the text that the terminal shows at the start: the links, and who can use them."""
    if tokens is None:
        return f"The page: {url} (on this computer alone; Ctrl-C ends it)"
    operator = with_token(url, tokens.operator)
    readable = ", and the network can read it (http, not https)" if url.startswith("http:") else ""
    return (
        f"To play and run it: {operator}\n{qr_code(operator)}\n"
        f"To view, and to STOP: {with_token(url, tokens.viewer)}\n"
        f"Anyone with a link can use it{readable}.\nCtrl-C ends the page."
    )
