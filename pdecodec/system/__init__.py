"""What the operating system gives: files, threads, processes; and what callers give.

``arguments.py`` checks what callers give. ``reading.py`` opens regular files alone, and of those that a file names
only the ones in its folder. ``whole_output.py`` makes outputs appear whole or not at all, whatever is killed or full
meanwhile. ``storage.py`` reads and writes files at addresses (HTTP, S3). ``shares.py`` divides work among threads.
``workers.py`` runs functions in worker processes and handles their interrupts and deaths. Nothing here knows of
meshes or of the codec.
"""
