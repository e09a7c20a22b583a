"""From SNR to packet error rate: noise, interference, error models, bursts."""
