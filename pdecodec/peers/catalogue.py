"""The peers, in the order in which tables have them."""

from __future__ import annotations

from pdecodec.peers.bspline import BSpline
from pdecodec.peers.coddyac import Coddyac
from pdecodec.peers.corrected import Corrected
from pdecodec.peers.cosine import CosineInTime
from pdecodec.peers.delta import QuantiseDelta
from pdecodec.peers.draco import Draco
from pdecodec.peers.lorenzo import Lorenzo
from pdecodec.peers.meshopt import Meshopt
from pdecodec.peers.peer import Peer
from pdecodec.peers.raw import RawFloat16, RawFloat32
from pdecodec.peers.shapes import PrincipalShapes
from pdecodec.peers.sz3 import Sz3
from pdecodec.peers.zfp import Zfp


def all_peers() -> tuple[Peer, ...]:
    """Every peer, whether its package is installed or not."""
    return (
        RawFloat32(),
        RawFloat16(),
        QuantiseDelta(),
        Meshopt(),
        Draco(),
        Zfp(),
        Sz3(),
        BSpline(),
        Lorenzo(),
        CosineInTime(),
        Corrected(CosineInTime()),
        PrincipalShapes(),
        Corrected(PrincipalShapes()),
        Coddyac(),
        Corrected(Coddyac()),
    )


def available_peers() -> tuple[tuple[Peer, ...], tuple[str, ...]]:
    """Peers that can run here, and for each of the others why it cannot."""
    reasons = [(peer, peer.missing()) for peer in all_peers()]
    return (
        tuple(peer for peer, reason in reasons if reason is None),
        tuple(reason for _, reason in reasons if reason is not None),
    )
