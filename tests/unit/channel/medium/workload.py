"""A workload of fixed numbers over all radios that ship; prints the SHA-256 of its record, radio by radio.

A program of its own, as numpy chooses its instructions when it is imported: `python workload.py`.
"""

import hashlib
import math
import warnings

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.validity import ValidityWarning
from tests.unit.channel.medium.one_by_one import settled, transmitted

TICK_NS = 50_000_000
TICKS = 20
NODES = [str(i) for i in range(4)]
SCALE_M = {
    "gazebo-classic": 6.0,
    "gz-rfcomms": 25.0,
    "lte-like": 7000.0,
    "telemetry-915": 9000.0,
    "wifi-2.4": 700.0,
    "sik-433": 9000.0,
    "sik-868": 9000.0,
    "rfd900x": 20000.0,
    "xbee-900hp": 9000.0,
    "elrs-2.4-333full": 9000.0,
    "elrs-900-200": 12000.0,
}
HILLS = [[0.0, 90.0, 0.0], [30.0, 0.0, 60.0], [0.0, 10.0, 0.0]]
VARIANTS = {
    "al-hourani": {"propagation": {"model": "al-hourani", "outside": "warn"}},
    "uma-av-own-sigma": {
        "propagation": {"model": "uma-av", "outside": "clamp"},
        "shadowing": {"model": "gudmundson", "sigma_db": None, "decorrelation_m": 20.0},
    },
    "uma-av": {"propagation": {"model": "uma-av", "outside": "clamp"}},
    "okumura-hata": {"propagation": {"model": "okumura-hata", "city": "large", "outside": "warn"}},
    "terrain": {
        "propagation": {"model": "terrain", "outside": "border", "spacing_m": 150.0, "heights_m": HILLS}
    },
    "rayleigh": {"fading": {"model": "rayleigh", "coherence": "doppler"}},
    "rayleigh-blocks": {"fading": {"model": "rayleigh", "coherence": "block"}},
    "nakagami": {"fading": {"model": "nakagami", "m": 2.5}},
    "rician-sphere": {
        "fading": {"model": "rician", "k_db": 3.0, "coherence": "doppler", "scattering": "sphere"}
    },
    "surroundings": {
        "shadowing": {
            "model": "gudmundson",
            "sigma_db": 5.0,
            "decorrelation_m": 20.0,
            "shared_ends": 0.4,
        },
    },
    "rician": {"fading": {"model": "rician", "k_db": 3.0, "k_overhead_db": 15.0}},
    "64qam": {"error": {"model": "uncoded-awgn", "modulation": "64qam"}},
    "ofdm-nist": {"error": {"model": "ofdm-nist", "rate_mbps": 12}},
    "ofdm-yans": {"error": {"model": "ofdm-yans", "rate_mbps": 54}},
    "sector": {"antenna": {"model": "sector"}},
    "interferer": {
        "interference": {"interferers": [{"position_ned_m": [9, 9, 0], "power_dbm": 5, "duty": 0.5}]}
    },
    "bursts": {"bursts": {"model": "gilbert-elliott", "mean_good_s": 0.3, "mean_bad_s": 0.1}},
}


def radios():
    """All presets, and `corrected` with every kind of model that none of them has."""
    yield from ((name, Radio(presets.load_radio(name))) for name in presets.preset_names())
    yield from ((name, Radio(presets.load_radio("corrected", tree))) for name, tree in VARIANTS.items())


def place(node, tick, scale_m):
    """Somewhere on a curve of its own, by arithmetic that has the same bits everywhere."""
    phase = (0.137 * node + 0.011 * tick * (1 + node)) % 1.0
    turn = 4.0 * abs(phase - 0.5) - 1.0
    return (
        scale_m * (0.4 + 0.3 * node) * turn,
        scale_m * (1.0 - turn * turn),
        -20.0 - 11.0 * node - 0.3 * tick,
    )


def record(radio, scale_m):
    """The lines of a record, with the columns of a run's deliveries, and after each all bits of its numbers."""
    medium = Medium(radio, seed=7, nodes=NODES)
    for tick in range(TICKS + 1):
        for i, node in enumerate(NODES):
            roll = 0.1 * ((tick + i) % 7)
            attitude = (math.sqrt(1.0 - roll * roll), roll, 0.0, 0.0)
            medium.observe(node, tick * TICK_NS, place(i, tick, scale_m), attitude)
        assert not settled(medium)
        for i, node in enumerate(NODES):
            for r in transmitted(medium, node, tick, tick * TICK_NS - 7_000_001 * i, 40 + 60 * (tick % 2)):
                yield (
                    f"{r.sim_time_ns},{r.tx},{r.rx},{r.seq},{r.length_bytes},{r.distance_m:.3f},"
                    f"{r.received_power_dbm:.3f},{r.snr_db:.3f},{r.per:.7g},{r.fate.value}\n"
                )
                yield f"{r!r}\n"


def main():
    """Print a line for each radio: name, receptions, how many arrived, digest."""
    warnings.simplefilter("ignore", ValidityWarning)
    for name, radio in radios():
        lines = list(record(radio, SCALE_M.get(name, 330.0)))
        arrived = sum(",delivered\n" in line for line in lines)
        print(name, len(lines) // 2, arrived, hashlib.sha256("".join(lines).encode()).hexdigest())


if __name__ == "__main__":
    main()
