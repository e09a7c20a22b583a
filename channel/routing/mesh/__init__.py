"""Routes that nodes find by themselves, as B.A.T.M.A.N. IV does.

originator  its messages, and the numbers of its source
ranking     how good each neighbour is as a next node, by originator
station     one node
mesh        all of a network
"""
