"""Services of the operating system (files, threads, processes), and checks of arguments.

``arguments.py`` checks arguments of callers. ``reading.py`` opens only regular files, and of the files that a file
names only those in its folder. ``whole_output.py`` makes outputs appear whole or not at all, even if the process is
killed or the disk is full. ``storage.py`` reads and writes files at addresses (HTTP, S3). ``shares.py`` divides work
among threads. ``workers.py`` runs functions in worker processes and handles their interrupts and deaths. Nothing
here knows of meshes or of the codec.
"""
