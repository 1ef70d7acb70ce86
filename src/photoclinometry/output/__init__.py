"""What others read: the report and the exports."""
