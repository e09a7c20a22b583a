"""RF sensors: the power of emitters as aircraft measure it, by the models that links are made of."""
