"""The real fish.

Turns a gait into set-points for the tail servos, keeps them inside angle, rate and pulse limits, and falls back to
neutral and disabled whenever it is in doubt.

From a gait to the servo:

* `servo_driver`: the node; `managed_node`: its life cycle; `driver_topics`, `diagnosis`: what it tells;
* `robot_states`: what a robot waits for before it may swim; `accepted_gait`: what became of the gait accepted last;
* `mailbox`: from the node to the thread; `io_thread`, `device_loop`: which alone speaks to the device;
* `tail`: what the tail does from tick to tick; `set_points`, `relay`: from the gait to each servo or relay;
  `servo_holder`: leads a servo slowly to a place;
* `safety`: the limits that every set-point passes, and the watchdog; `emergency_stop`: its service;
* `health`: what is seen of a device; `line`, `port`: the serial line; `backends/`: one file a device;
* `clock`, `wall_clock`: time that is handed in, and its stamps.

The robot and its person:

* `robot_file`: the robot's YAML file; `robot_setup`: what is driven over which port;
* `operator`: the terminal program; `driver_client`, `requests`: the driver as a person's program sees it;
* `next_step`: what the person should do now; `fin_instruction`: a fin as a person would cut it;
* `calibrate_servo`, `calibration`: a servo's numbers, measured step by step.

The tracked fish:

* `velocity_estimator`: the node, from poses to velocities; `velocity_estimate`: how;
* `pose_checks`, `lost_fish`, `course`: poses that no fish gives.

The robot that is not there: `rehearsal`, the node; `emulator/`, its devices and its fish.
"""
