/* An Arduino Uno in simavr: runs a firmware's hex file with its UART on a pty, and tells of the pulses of pin 9.
 *
 *   uno FIRMWARE.hex
 *
 * Output, a line each; every time is in cycles of the simulated processor, 16 to a us, whatever the host is busy with:
 *   pty /dev/pts/N                 once
 *   pulse START WIDTH SET WAIT     after each pulse at the pin. SET: what the firmware's servo library has set timer 1 to.
 *                                  WAIT: from the timer's match to the start of its handler, which then ends the pulse
 *   byte TIME HEX                  after each byte that the firmware's receive handler has read
 *   handler VECTOR CYCLES          whenever an interrupt handler, timer 1's aside, has run longer than any before
 *   clock NOW                      ten times a simulated second, so that a reader sees pulses stop
 * Ends when its standard input is closed.
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
#include <simavr/sim_interrupts.h>

#define FREQUENCY 16000000UL
#define SLICE_CYCLES (FREQUENCY / 1000) /* look at the real clock every simulated ms */

/* ATmega328P data sheet, table 12-6 (vectors, here from 0 for reset) and section 36 (registers in data space). */
enum { TIMER1_COMPA = 11, USART_RX = 18, VECTORS = 26 };
enum { TCNT1L = 0x84, TCNT1H = 0x85, OCR1AL = 0x88, OCR1AH = 0x89, UDR0 = 0xC6 };
#define CYCLES_A_TICK 8 /* the servo library runs timer 1 from the clock over 8 */

static avr_t *avr;
static avr_cycle_count_t matched, begun[VECTORS], longest, wait;

static void timer_1_pending(struct avr_irq_t *irq, uint32_t level, void *unused)
{
    (void)irq, (void)unused;
    if (level)
        matched = avr->cycle;
}

static void handler_runs(struct avr_irq_t *irq, uint32_t level, void *vector_number)
{
    long vector = (long)vector_number;
    (void)irq;
    if (level) {
        begun[vector] = avr->cycle;
        if (vector == TIMER1_COMPA)
            wait = avr->cycle - matched;
        return;
    }
    avr_cycle_count_t cycles = avr->cycle - begun[vector];
    if (vector != TIMER1_COMPA && cycles > longest) {
        longest = cycles;
        printf("handler %ld %llu\n", vector, (unsigned long long)cycles);
    }
    if (vector == USART_RX)
        printf("byte %llu %02x\n", (unsigned long long)avr->cycle, avr->data[UDR0]);
}

static void pin_9_changed(struct avr_irq_t *irq, uint32_t level, void *unused)
{
    static avr_cycle_count_t rise;
    static uint16_t ticks;
    (void)irq, (void)unused;
    if (level) {
        /* The library has just read the counter, added the pulse's ticks, and set the match to the sum. */
        uint16_t counter = avr->data[TCNT1L] | avr->data[TCNT1H] << 8;
        ticks = (avr->data[OCR1AL] | avr->data[OCR1AH] << 8) - counter;
        rise = avr->cycle;
    } else if (rise) {
        printf("pulse %llu %llu %u %llu\n", (unsigned long long)rise, (unsigned long long)(avr->cycle - rise),
               CYCLES_A_TICK * ticks, (unsigned long long)wait);
    }
}

static void watch_interrupts(void)
{
    for (long vector = 1; vector < VECTORS; vector++) {
        avr_irq_t *irq = avr_get_interrupt_irq(avr, vector);
        if (!irq)
            continue;
        avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, handler_runs, (void *)vector);
        if (vector == TIMER1_COMPA)
            avr_irq_register_notify(irq + AVR_INT_IRQ_PENDING, timer_1_pending, NULL);
    }
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
    watch_interrupts();

    double begin = seconds();
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    for (avr_cycle_count_t slice = 1; poll(&input, 1, 0) == 0; slice++) {
        while (avr->cycle < slice * SLICE_CYCLES)
            if (avr_run(avr) >= cpu_Done)
                _exit(1);
        if (slice % 100 == 0)
            printf("clock %llu\n", (unsigned long long)avr->cycle);
        double ahead = avr->cycle / (double)FREQUENCY - (seconds() - begin);
        if (ahead > 0.001)
            usleep(1e6 * ahead);
    }
    _exit(0); /* the pty's thread would not end by itself */
}
