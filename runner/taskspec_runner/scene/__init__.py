"""The arm in its world, moving in a page: what is in the scene, and the script that draws it.

A page needs two things. `scene.model.model_scene` states what is there: bodies with their joints,
geoms, meshes, a camera, as data for JSON. `scene.bundle.bundle` is the script, three.js included,
that sets `taskspecScene`; in the page

    const arm = taskspecScene.create(element, scene);
    arm.show({ q, point, axes, force });

`element` is any block with a size. `q` is a row of positions as `model_scene` orders them, the
model's `qpos` with the poses of its mocap bodies behind (`scene.model.positions`); what else a
state may have, and what else `arm` can do, stands in `js/scene.js`. `video.camera.frame_arm` frames
a model of which no run is known yet. A page that plays a recorded run takes
`scene.recorded.recorded_scene`, which adds the run's rows, and `taskspecScene.track`.
"""
