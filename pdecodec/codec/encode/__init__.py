"""The encoder: a mesh sequence in, a `.pdeanim` file out, a group of frames in memory at a time.

Begin with ``encoder.py``. ``profiles.py`` chooses the encoder: ``paper_profile.py`` or ``auto_profile.py``, both upon
``group_encoder.py``, which goes from group to group and gathers the sections. Profile "auto" searches in
``model_choice.py`` (reference frame and space basis, once) and ``group_choice.py`` (every group), by the estimates of
``estimate.py`` on large meshes. ``group_fit.py`` fits and codes a group: ``displacements.py`` and ``principal.py`` find
functions of time, ``quantisation.py`` and ``refinement.py`` choose whole numbers. ``effort.py`` and ``memory.py`` bound
the work. ``rate_control.py`` searches the tolerance of a size or a mean error. ``run_encoder.py`` encodes runs of
different faces, ``coded_order.py`` brings a mesh into the order that costs nothing. ``alternatives.py`` and
``stored_choices.py`` tell what else could have been chosen. ``appending.py`` codes frames with the model of a file;
``report.py`` has what an encode tells.
"""
