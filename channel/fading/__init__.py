"""Random parts of the received power: shadowing and fading."""
