"""Bytes on disk: who writes, how a file appears, what may be read, the log of each process.

folder: A folder of files with confined names: what is read is a regular file of bounded size, below the folder
lock: Locks that the system gives back when a process ends, however it ends; no clock takes part
log: The log of one process, and the logs of all that work in a folder
owner: Who writes: the identity of a process, and whether it still runs
records: Records as lines of JSON, each with a checksum of its own
writing: The write protocol: a file appears completely or not at all
"""
