"""Logs, tables, frames and run folders as files.

``records`` reads input-output records from logs of all formats, ``runs`` names and writes the files of a run folder, ``mcap_log``
writes a run's log, ``mcap_read`` and ``sensor_log`` read it. ``messages``, ``standard_messages``, ``scene_messages`` and ``decode``
are the ROS messages of the signals, ``message_files`` and ``topics`` the message logs of any origin. ``frames`` reads depth images,
point clouds and recordings, ``live`` depth cameras.
"""
