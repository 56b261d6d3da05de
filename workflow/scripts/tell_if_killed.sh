# Say what a command cannot say itself: that it was killed, or crashed under a limit. Argument: its exit status.
case $1 in
137)
    echo "egosplat: the stage was killed, most likely for lack of memory: free some, or see docs/scale.md for what takes less." \
        "The same command goes on from here" >&2
    ;;
134 | 139) # SIGABRT and SIGSEGV: so libraries end that were refused memory
    [ "$(ulimit -v)" = unlimited ] ||
        echo "egosplat: the stage crashed, most likely because ulimit -v allows $(ulimit -v) KiB, and PyTorch's libraries" \
            "alone map up to 4,000,000: raise it, or set none. The same command goes on from here" >&2
    ;;
esac
