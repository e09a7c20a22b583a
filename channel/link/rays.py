"""What two antennas make of the ray that the ground reflects."""

from __future__ import annotations

import numpy as np

from channel.antenna import AntennaModel, to_body
from channel.geometry import LEVEL_WXYZ, Path, reflected_ways_ned
from channel.propagation.path_loss import PathLossModel


def with_reflection(
    path: Path, propagation: PathLossModel, tx: AntennaModel | None, rx: AntennaModel
) -> Path:
    """Return the path with the antennas' gains along the reflected ray, if the propagation asks for them.

    Args:
        path: the links.
        propagation: the law of the way.
        tx: antenna of the transmitter; None: the same in every direction.
        rx: antenna of the receiver.
    """
    by_direction = rx.needs_direction or (tx is not None and tx.needs_direction)
    if not propagation.by_rays or not by_direction:
        return path
    attitudes = path.attitude_tx_wxyz, path.attitude_rx_wxyz
    level = [LEVEL_WXYZ if attitude is None else attitude for attitude in attitudes]
    direct, (down_tx, down_rx) = path.way_ned, reflected_ways_ned(path)
    more_db = rx.towards_db(to_body(level[1], down_rx)) - rx.towards_db(to_body(level[1], -direct))
    if tx is not None:
        more_db = (
            more_db + tx.towards_db(to_body(level[0], down_tx)) - tx.towards_db(to_body(level[0], direct))
        )
    return path._replace(reflected_gain_db=np.asarray(more_db))
