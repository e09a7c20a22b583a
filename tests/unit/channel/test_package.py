"""What `channel` gives by itself, and what it costs."""

import subprocess
import sys

import pytest

import channel


def test_the_names_of_the_readme_are_there():
    from channel import Medium, Radio, fit, load_radio, simulate
    from channel.draws import Draws

    radio = Radio(load_radio("moon2020"))
    assert Medium(radio, seed=1, nodes=("a", "b")).nodes == ("a", "b")
    outcome = simulate(radio, Draws(1), [("a", "b")], 400.0, packets=50)
    assert outcome.delivered.shape == (1, 50)
    assert set(channel.__all__) == {"Medium", "Radio", "fit", "load_radio", "simulate"}
    assert callable(fit.fit_radio)


def test_no_other_name():
    with pytest.raises(AttributeError, match="Raido"):
        _ = channel.Raido


def test_importing_the_package_is_cheap():
    script = "import channel, sys; print([m for m in ('numpy', 'scipy', 'pydantic') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
