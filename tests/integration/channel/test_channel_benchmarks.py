"""The channel's benchmark, in short."""

import json

from benchmarks.channel import bench_channel, bench_fit


def test_ticks_batches_and_single_packets_are_measured(capsys):
    bench_channel.main(["--rounds", "2", "--json"])
    figures = json.loads(capsys.readouterr().out)
    assert figures["radio"] == "moon2020"
    yardstick_ns = 1e3 * figures["numpy_add_us"]
    assert 0.0 < figures["batch_ns_per_link"] < yardstick_ns  # far below it on any machine
    assert 0.0 < figures["tick_ns_per_link"] < 4.0 * yardstick_ns
    assert 0.0 < figures["books_ns_per_link"] < 4.0 * yardstick_ns
    assert 0.0 < figures["packet_us"] < 2.0 * yardstick_ns


def test_fleets_are_measured_for_presets(capsys):
    bench_channel.print_fleets(["moon2020", "wifi-2.4"], [10, 70], 1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[-2:]] == ["moon2020", "wifi-2.4"]
    assert all(float(ns) > 0.0 for line in lines[-2:] for ns in line.split()[1:])


def test_a_fit_of_many_packets_takes_little_longer_than_one_of_few(capsys):
    bench_fit.main(["--only", "no RSSI, sigma known", "--packets", "10000", "200000", "--json"])
    few, many = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert few["cpu_s"] > 0.0
    assert many["cpu_s"] < 15.0 * few["cpu_s"]
    assert many["log_likelihood"] < 10.0 * few["log_likelihood"] < 0.0
