# Say what a command cannot say itself: that it was killed. Argument: its exit status.
if [ "$1" -eq 137 ]; then
    echo "egosplat: the stage was killed, most likely for lack of memory: free some, or see docs/scale.md for what takes less." \
        "The same command goes on from here" >&2
fi
