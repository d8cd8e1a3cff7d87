"""The page at the tank: a study and its fish on a phone, with the buttons of the person beside it.

* `board`: what a page is told, from what was heard; `offers`: which buttons it has, and whether a press counts;
  `fish_shape`: the fish as it is drawn, and its speed. None of them knows ROS, a socket or a clock.
* `graph`: listens, asks and stops, in a thread of its own; `fish_streams`: takes the newest of what the fish tells.
  These two alone know ROS.
* `server`: pages over HTTP and one WebSocket each; `access`: who may; `action_log`: who did what, in the study's
  folder.
* `command`: `ros2 run fin_bringup page`; `static/`: what runs in the browser.
"""
