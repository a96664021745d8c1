"""Files, caches and signals of a process.

=================  ====================================================================
``atomic_write``   atomic writes of files
``cache``          folder of compiled programs
``extras``         commands that install optional dependencies
``run_directory``  result folder of one run, with a lock
``signals``        orderly termination after Ctrl-C and SIGTERM
=================  ====================================================================
"""
