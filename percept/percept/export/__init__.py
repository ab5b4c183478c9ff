"""What a run leaves behind: tables, the 3D view, the report, and messages for other programs.

Import from the modules: `tables` and `journal` (Parquet, and what makes a run resumable), `view`
(the only importer of rerun), `report` and `detection_report` (HTML), `overlay` (MCAP),
`pictures` and `palette`. This package imports none of them, since some are heavy.
"""
