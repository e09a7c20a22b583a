"""Packets that other nodes hand on: routing over one radio network, between a run's packets and its medium.

router    what a way of routing decides, node by node
journey   one packet on its way, and which of its losses tells why it did not come
routed    the network: hops in, fates of whole journeys out
flood, static, mesh   ways of routing
settings  as scenarios name them
"""
