"""Which effects the records need: score tests, and forward selection with a backward step."""
