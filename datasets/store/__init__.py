"""What datasets are kept in, and how: who writes, how a file appears, what may be read, the log of each process.

addresses: Addresses of datasets: a folder, or a URL such as s3://bucket/name
bucket: A place of an object store: S3, Google, Azure, a web server that is only read, or what fsspec knows
folder: A folder of a disk with confined names: what is read is a regular file of bounded size, below the folder
fsspec_client: Any other file system that fsspec knows, with the calls that `Bucket` makes of obstore's client
lock: Locks that the system gives back when a process ends, however it ends; no clock takes part
log: The log of one process, and the logs of all that work in a folder
log_files: Logs in a folder of a disk: a file each, to which its process appends, and which it locks while it works
log_objects: Logs in an object store, which cannot append: each appended piece is an object of its own, numbered
object_failures: What an object store's client says when a request fails, in one line
owner: Who writes: the identity of a process, and whether it still runs
records: Records as lines of JSON, each with a checksum of its own
store: What a dataset is kept in: a folder of a disk, or a place of an object store; both have the same calls
writing: The write protocol: a file appears completely or not at all
"""
