"""`lostlink attach`: a program in a network namespace whose only way out is the radio of a node.

addresses  the IPv4 address of each node
forwarder  which node an IP packet is for, and what is dropped; no I/O
namespace  makes the namespaces and the interface, and runs the program in them: a program of its own
program    starts that, and ends it with all that it started
claim      one program to a node
run_clock  which wall time belongs to an instant, and whether the run keeps up
link       moves packets between the interface and the run
serve      from the program's start to its end
plan       from what a user asks for to all of this
"""
