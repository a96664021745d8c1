"""Files, caches and signals of a process.

=================  ====================================================================
``atomic_write``   atomic writes of files
``bounded_read``   reading of files of limited size
``cache``          folder of compiled programs
``extras``         commands that install optional dependencies
``run_directory``  result folder of one run, with a lock
``text``           values from files as text in messages
``signals``        orderly termination after Ctrl-C, SIGTERM and SIGHUP
=================  ====================================================================
"""
