"""Robot and objects as one MuJoCo model: read, checked, composed, and its rigid-body quantities."""
