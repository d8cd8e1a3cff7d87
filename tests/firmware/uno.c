/* An Arduino Uno in simavr: runs a firmware's hex file with its UART on a pty, and prints the pulses of pin 9.
 *
 *   uno FIRMWARE.hex
 *
 * Output, a line each:  "pty /dev/pts/N" once;  "pulse START_US WIDTH_US" for every pulse;  "clock NOW_US" ten times a
 * second, so that a reader sees pulses stop. Times are of the simulated clock. Ends when its standard input is closed.
 */
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/parts/uart_pty.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>

#define FREQUENCY 16000000UL
#define CYCLES_A_US (FREQUENCY / 1000000.0)
#define SLICE_CYCLES (FREQUENCY / 1000) /* look at the real clock every simulated ms */

static avr_t *avr;

static void pin_9_changed(struct avr_irq_t *irq, uint32_t level, void *unused)
{
    static avr_cycle_count_t rise;
    (void)irq, (void)unused;
    if (level)
        rise = avr->cycle;
    else if (rise)
        printf("pulse %.3f %.3f\n", rise / CYCLES_A_US, (avr->cycle - rise) / CYCLES_A_US);
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

int main(int count, char **arguments)
{
    static uart_pty_t uart;
    uint32_t size = 0, start = 0, flags = 0;
    uint8_t *code = count == 2 ? read_ihex_file(arguments[1], &size, &start) : NULL;
    setvbuf(stdout, NULL, _IOLBF, 0);
    avr = avr_make_mcu_by_name("atmega328p");
    if (!code || !avr) {
        fprintf(stderr, "usage: uno FIRMWARE.hex\n");
        return 2;
    }
    avr_init(avr);
    avr->frequency = FREQUENCY;
    avr_loadcode(avr, code, size, start);
    avr->codeend = avr->flashend;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP); /* own pacing below */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart_pty_init(avr, &uart);
    uart_pty_connect(&uart, '0');
    printf("pty %s\n", uart.pty.slavename);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 1), pin_9_changed, NULL);

    double begin = seconds();
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    for (avr_cycle_count_t slice = 1; poll(&input, 1, 0) == 0; slice++) {
        while (avr->cycle < slice * SLICE_CYCLES)
            if (avr_run(avr) >= cpu_Done)
                _exit(1);
        if (slice % 100 == 0)
            printf("clock %.3f\n", avr->cycle / CYCLES_A_US);
        double ahead = avr->cycle / (double)FREQUENCY - (seconds() - begin);
        if (ahead > 0.001)
            usleep(1e6 * ahead);
    }
    _exit(0); /* the pty's thread would not end by itself */
}
