"""Random scenes of all features together: a seed gives a scene on which run, checks, log replay and an oracle agree.

``uv run --group dev python -m tests.random_scenes 0 300 --jobs 2`` runs a range of seeds and groups what differs by cause.
A seed is never left out; refusals and runs that end early are counted apart. Every feature of the product joins here
before it counts as done. Each topic has random numbers of its own (:mod:`tests.random_scenes.dice`), so that it
changes no other one.

- **Bodies**: one or two arms of hinges and slides on a base that floats, is planar or turns about a point; one to
  three objects, spatial or planar, some of two geoms or with a panel on a hinge, slide or ball joint; spheres,
  capsules, boxes, cylinders, ellipsoids, meshes (hulls, frusta, prisms, grids); everything in a plane; armatures;
  flexible drives; springs and dampers; limits with restitution, ignored limits, stripped elements; masses of the
  scenario; a fixed wall or post.
- **Unions**, in a third of the scenes: bases, links, objects and walls of several pieces (boxes cut at random, corners,
  T-slots, crosses, rods of two cylinders, wedges of meshes), meshes that are decomposed, a wall of terrain or the inside
  of a cone.
- **Contact**: rules by geoms, by models or one default; the ends of two arms with each other; restitution 0 to 1 and
  above; friction; ``blend``, ``poisson`` and ``newton``; rest interval and rest speed; faces that are parallel to the
  last bit or within 1e-3 rad; presses, approaches in line and fly-bys with gaps of rounding to 0.3 m.
- **Grasps**: up to two, by touch or bounds, of every latch, with load limits, on one object or two, by one arm or
  two, one that takes over from another; armed, missed, released, armed again.
- **Actuators**: joint motors, thrusters, torquers, wheels and motors of a planar base; ideal, on a torque-speed line,
  wheels that saturate, on-off valves; delays of commands, late control ticks.
- **Laws**: playback of tables and logs (held, mean, linear), ``pd``, ``hold``, ``joint_path``, ``track``,
  ``task_ct``, ``rns``, ``task_tj``, ``gjm_rate``, ``impedance``, ``base_pd``, ``free_flying``, ``off``, several parts
  at once; models of control laws that are wrong or rigid; moving targets.
- **Phases**: times, impacts, contacts, grasps, measurements, ``stop_when``, branches; the end at the first impact.
- **Sensors**: every kind that a robot's file may have, cameras with fields of view and occlusion; intervals, delays,
  jitter, dropouts, noise, bias and walk, scale, misalignment, quantum, cutoff; estimators; laws that are told of no
  or hard impacts.
- **World**: steps of 0.5 to 10 ms with control periods of 1 to 5 steps, ``accuracy``, gravity with ``gravcomp``,
  turned and boosted frames.

Not drawn: what ends a run at once or has no checks (dry friction, equalities), what is no part of the motion (output,
``env``, ``uncertainties``), laws that are tuned to one robot (``osdre``, ``lqr``, ``detumble``, ``gripper``), grasps
between two objects, and a start from another run.
"""
