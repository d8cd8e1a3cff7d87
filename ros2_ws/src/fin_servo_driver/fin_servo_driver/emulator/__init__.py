"""A robot that is not there: devices that speak the makers' protocols on a pty, and the hidden fish that they move.

* `devices`: what each device does with the bytes that it gets; `packets`: those of Dynamixel servos;
* `pty_port`: a device on a pseudo-terminal, which can be unplugged, fall silent, lose bytes or be slow;
* `emulate`: the device that fits a robot file, and the angles of the joints from its outputs;
* `hidden_fish`: the fish that these joints move, whose numbers the optimiser does not know.
"""
