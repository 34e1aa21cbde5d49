@ Single-precision add, subtract, multiply, divide and compare for the RP2040, which has no FPU and
@ counts no leading zeros, but multiplies 32 bits in one cycle and has an integer divider beside the
@ core. Bound to the names that compiled code calls (Arm's run-time ABI for floating point, 4.1.2);
@ the linker takes these instead of the compiler's, which are weak.
@
@ Same results as an FPU's, to the bit: IEEE 754, round to nearest, ties to even, subnormals too.
@ The bits of a NaN are not defined.
@
@ Rounding: a fraction with too many bits is shifted right. The last bit shifted out is then in the
@ carry and is added, which rounds correctly except ties, which go up. So a result whose other spare
@ bits are all zero takes another path, slower and rare.

    .syntax unified
    .thumb

@ r0 = r0 - r1, and below it r0 = r0 + r1.
    .section .text.__aeabi_fadd, "ax", %progbits
    .balign 4
    .global __aeabi_fsub
    .type __aeabi_fsub, %function
    .thumb_func
__aeabi_fsub:
    movs r2, #1
    lsls r2, #31
    eors r1, r2

    .global __aeabi_fadd
    .type __aeabi_fadd, %function
    .thumb_func
__aeabi_fadd:
    movs r2, r0
    eors r2, r1
    mov r12, r4
    bmi .Lopposite

@ Equal signs: the larger number to r0.
    cmp r0, r1
    bhs 2f
    eors r0, r2
    eors r1, r2
2:  lsrs r3, r0, #23                @ its sign and exponent
    uxtb r4, r3
    cmp r4, #255
    beq .Ladd_not_finite
    lsls r1, #1
    lsrs r2, r1, #24
    beq .Lsum_of_subnormal
    subs r2, r3, r2                 @ distance of the exponents; of the sign only above eight bits
    movs r4, #1
    lsls r4, #31
    lsls r0, #8                     @ fractions to the left end, their hidden bits the topmost
    orrs r0, r4
    lsls r1, #7
    orrs r1, r4
.Lsum:
    movs r4, r1
    lsrs r1, r2
    adds r0, r0, r1
    bcs .Lsum_carry
    lsls r1, r0, #25
    beq .Lsum_tie
@ Sign and exponent in r3, fraction in r0, hidden bit topmost.
.Lround:
    subs r3, #1                     @ the hidden bit adds one
    lsls r3, #23
    lsrs r0, #8
    adcs r0, r3
    mov r4, r12
    bx lr

@ Twice as large; the carry is the hidden bit.
.Lsum_carry:
    adds r3, #1
    uxtb r1, r3
    cmp r1, #255
    beq .Lsum_infinite
    lsls r3, #23
    lsls r1, r0, #24
    beq 3f
2:  lsrs r0, #9
    adcs r0, r3
    mov r4, r12
    bx lr
3:  negs r2, r2                     @ what the smaller number lost
    adds r2, #32
    lsls r4, r2
    bne 2b
    lsrs r1, r0, #10                @ tie or exact: up only if odd
    bcs 2b
    lsrs r0, #9
    orrs r0, r3
    mov r4, r12
    bx lr

.Lsum_infinite:
    lsls r0, r3, #23
    mov r4, r12
    bx lr

.Lsum_tie:
    negs r2, r2
    adds r2, #32
    lsls r4, r2
.Ltie:
    bne .Lround                     @ there is more below
    lsrs r1, r0, #9
    bcs .Lround
    subs r3, #1
    lsls r3, #23
    lsrs r0, #8
    adds r0, r0, r3
    mov r4, r12
    bx lr

@ The smaller, doubled in r1, is zero or subnormal.
.Lsum_of_subnormal:
    cmp r1, #0
    beq .Lreturn
    uxtb r2, r3
    cmp r2, #0
    beq 2f
    subs r2, #1
    lsls r1, #7
    lsls r0, #8
    movs r4, #1
    lsls r4, #31
    orrs r0, r4
    b .Lsum
2:  lsrs r1, #1                     @ both are
    adds r0, r0, r1
.Lreturn:
    mov r4, r12
    bx lr

@ r0 is infinite or not a number, and r1 does not change it.
.Ladd_not_finite:
    lsls r1, r0, #9
    beq .Lreturn
    movs r1, #1
    lsls r1, #22
    orrs r0, r1
    mov r4, r12
    bx lr

@ Opposite signs.
.Lopposite:
    lsls r3, r0, #1
    lsls r4, r1, #1
    cmp r3, r4
    beq .Lcancelled
    blo 2f
    movs r1, r4
    b 3f
2:  movs r0, r1
    movs r1, r3
    movs r3, r4
3:  lsrs r3, #24
    cmp r3, #255
    beq .Ladd_not_finite
    lsrs r2, r1, #24
    beq .Ldifference_of_subnormal
    subs r2, r3, r2
    lsrs r3, r0, #23
    movs r4, #1
    lsls r4, #31
    lsls r0, #8
    orrs r0, r4
    lsls r1, #7
    orrs r1, r4
.Ldifference:
    movs r4, r1
    lsrs r1, r2
    negs r2, r2
    adds r2, #32
    lsls r4, r2                     @ what the smaller number lost: if anything, one is borrowed
    negs r4, r4
    sbcs r0, r1
    bpl .Lshifted_left
    lsls r1, r0, #25
    bne .Lround
    cmp r4, #0
    b .Ltie

.Lshifted_left:
    adds r0, r0, r0
    bpl .Lcancelling
    subs r3, #1
    lsls r1, r3, #24
    beq .Lsubnormal                 @ r1 = 0 is its exponent
    lsls r1, r0, #25
    bne .Lround
    cmp r4, #0
    b .Ltie

@ More than one bit is gone: the exponents were at most one apart, nothing was lost.
.Lcancelling:
    movs r2, #1
    lsrs r1, r0, #16
    bne 2f
    lsls r0, #16
    adds r2, #16
2:  lsrs r1, r0, #24
    bne 2f
    lsls r0, #8
    adds r2, #8
2:  lsrs r1, r0, #28
    bne 2f
    lsls r0, #4
    adds r2, #4
2:  lsrs r1, r0, #30
    bne 2f
    lsls r0, #2
    adds r2, #2
2:  cmp r0, #0
    bmi 2f
    adds r0, r0, r0
    adds r2, #1
2:  uxtb r1, r3
    subs r1, r1, r2
    ble .Lsubnormal
    subs r3, r3, r2
    subs r3, #1
    lsls r3, #23
    lsrs r0, #8
    adds r0, r0, r3
    mov r4, r12
    bx lr
@ The exponent in r1 is not positive.
.Lsubnormal:
    movs r2, #9
    subs r2, r2, r1
    lsrs r0, r2
    lsrs r3, #8
    lsls r3, #31
    orrs r0, r3
    mov r4, r12
    bx lr

.Ldifference_of_subnormal:
    cmp r1, #0
    beq .Lreturn
    subs r2, r3, #1
    bmi 2f
    lsrs r3, r0, #23
    lsls r1, #7
    lsls r0, #8
    movs r4, #1
    lsls r4, #31
    orrs r0, r4
    b .Ldifference
2:  lsrs r1, #1
    subs r0, r0, r1
    mov r4, r12
    bx lr

@ Equal but for the sign: zero, unless they are infinite.
.Lcancelled:
    movs r0, #0
    lsrs r3, #24
    cmp r3, #255
    bne .Lreturn
    ldr r0, =0x7fc00000
    mov r4, r12
    bx lr
    .pool
    .size __aeabi_fadd, . - __aeabi_fadd
    .size __aeabi_fsub, __aeabi_fadd - __aeabi_fsub

@ r0 = r0 * r1.
    .section .text.__aeabi_fmul, "ax", %progbits
    .balign 4
    .global __aeabi_fmul
    .type __aeabi_fmul, %function
    .thumb_func
__aeabi_fmul:
    lsls r2, r0, #1
    lsrs r2, #24
    beq .Lfirst_small
    cmp r2, #255
    beq .Lrare_product
    lsls r3, r1, #1
    lsrs r3, #24
    beq .Lsecond_small
    cmp r3, #255
    beq .Lrare_product
    adds r2, r2, r3
    subs r2, #128
    cmp r2, #252
    bhi .Lrare_product
    adds r2, #1                     @ exponent of a product below two
    movs r3, r0
    eors r3, r1
    lsrs r3, #31
    lsls r3, #31
    lsls r2, #23
    orrs r2, r3
    mov r12, r4
    movs r3, #1
    lsls r3, #23
    lsls r0, #9
    lsrs r0, #9
    orrs r0, r3
    lsls r1, #9
    lsrs r1, #9
    orrs r1, r3
@ 24 by 24 bits from three products that fit 32 bits: of weight one in r3, 2^8 in r4 and
@ 2^20 in r1.
    uxtb r3, r0
    muls r3, r1
    lsrs r0, #8
    lsls r4, r1, #20
    lsrs r4, #20
    muls r4, r0
    lsrs r1, #12
    muls r1, r0
    lsrs r0, r3, #8
    adds r4, r4, r0
    lsrs r0, r4, #8
    lsls r1, #4
    adds r0, r0, r1                 @ upper 32 bits of the 48
    bpl 3f
    lsls r1, r0, #25
    beq 4f
2:  lsrs r0, #8                     @ the hidden bit makes the exponent right
    adcs r0, r2
    mov r4, r12
    bx lr
3:  lsls r1, r0, #26
    beq 5f
3:  lsls r0, #2                     @ without the hidden bit
    lsrs r0, #9
    adcs r0, r2
    mov r4, r12
    bx lr
4:  orrs r3, r4                     @ tie or exact, unless there is more below: up only if odd
    lsls r3, #24
    bne 2b
    lsrs r1, r0, #9
    bcs 2b
    lsrs r0, #8
    adds r0, r0, r2
    mov r4, r12
    bx lr
5:  orrs r3, r4
    lsls r3, #24
    bne 3b
    lsrs r1, r0, #8
    bcs 3b
    lsls r0, #2
    lsrs r0, #9
    adds r0, r0, r2
    mov r4, r12
    bx lr

.Lsecond_small:
    movs r2, r0
    movs r0, r1
    movs r1, r2
.Lfirst_small:
    lsls r2, r0, #1
    bne .Lrare_product
    lsls r2, r1, #1
    lsrs r2, #24
    cmp r2, #255
    beq .Lrare_product
    eors r0, r1
    lsrs r0, #31
    lsls r0, #31
    bx lr
.Lrare_product:
    ldr r2, =float_multiply
    bx r2
    .pool
    .size __aeabi_fmul, . - __aeabi_fmul

@ r0 = r0 / r1. With fractions x and y, x in [y, 2 y), the reciprocal of y's upper 16 bits comes
@ from the divider and is a little too small; two steps of long division with it, 14 and 10 bits,
@ leave at most the last bit to be corrected. A tie is not possible.
@
@ An interrupt may divide too, so the divisor is read back and compared: if it is the same, the
@ quotient is right, no matter which context computed it. The dividend is always the same, since
@ nothing else in the image uses the divider.
    .section .text.__aeabi_fdiv, "ax", %progbits
    .balign 4
    .global __aeabi_fdiv
    .type __aeabi_fdiv, %function
    .thumb_func
    .equ DIV_UDIVIDEND, 0x60        @ above SIO's base (RP2040 datasheet 2.3.1.7)
    .equ DIV_UDIVISOR, 0x64
    .equ DIV_QUOTIENT, 0x70
__aeabi_fdiv:
    lsls r2, r0, #1
    lsrs r2, #24
    beq .Lrare_quotient
    cmp r2, #255
    beq .Lrare_quotient
    lsls r3, r1, #1
    lsrs r3, #24
    beq .Lrare_quotient
    cmp r3, #255
    beq .Lrare_quotient
    subs r2, r2, r3
    adds r2, #125
    cmp r2, #252
    bhi .Lrare_quotient
    push {r4, r5}
    movs r4, #0xd0
    lsls r4, #24
    movs r5, #1
    lsls r5, #31
    str r5, [r4, #DIV_UDIVIDEND]
    lsls r3, r1, #8
    orrs r3, r5
    lsrs r3, #16
    adds r3, #1
    str r3, [r4, #DIV_UDIVISOR]
@ The divider takes eight cycles. Meanwhile: sign, exponent and fractions.
    movs r5, r0
    eors r5, r1
    lsrs r5, #31
    lsls r5, #31
    lsls r2, #23
    orrs r2, r5
    movs r5, #1
    lsls r5, #23
    lsls r0, #9
    lsrs r0, #9
    orrs r0, r5
    lsls r1, #9
    lsrs r1, #9
    orrs r1, r5
    adds r2, r2, r5
    cmp r0, r1
    bhs 2f
    lsls r0, #1
    subs r2, r2, r5
2:  ldr r5, [r4, #DIV_QUOTIENT]     @ 2^31 / (y / 2^8 + 1)
    ldr r4, [r4, #DIV_UDIVISOR]
    cmp r4, r3
    bne .Ldivide_again
    lsrs r3, r0, #9
    muls r3, r5
    lsrs r3, #17                    @ upper 14 bits, at most 2 too small
    lsls r0, #13
    movs r4, r3
    muls r4, r1
    subs r4, r0, r4                 @ remainder
    lsrs r4, #10
    muls r4, r5
    lsls r3, #10
    lsrs r4, #19
    adcs r3, r4                     @ all 24 bits, rounded, at most 1 too small
    lsls r0, #10
    movs r4, r3
    muls r4, r1
    subs r0, r0, r4                 @ remainder
    lsls r0, #1
    cmp r0, r1
    ble 3f
    adds r3, #1
3:  adds r0, r3, r2
    pop {r4, r5}
    bx lr
.Ldivide_again:
    movs r4, #0xd0
    lsls r4, #24
    movs r5, #1
    lsls r5, #31
    str r5, [r4, #DIV_UDIVIDEND]
    str r3, [r4, #DIV_UDIVISOR]
    b 3f                            @ two cycles each
3:  b 3f
3:  b 3f
3:  b 2b
.Lrare_quotient:
    ldr r2, =float_divide
    bx r2
    .pool
    .size __aeabi_fdiv, . - __aeabi_fdiv

@ Whether r0 is greater than r1, or greater or equal; with swapped arguments, less, or less or
@ equal. Numbers of the same sign compare as their bits do. A NaN is beyond infinity, so that only
@ the one of greater magnitude can be one.
    .macro compare less, greater, unless, zeros
    .section .text.\greater, "ax", %progbits
    .balign 4
    .global \less
    .type \less, %function
    .thumb_func
\less:
    movs r2, r0
    movs r0, r1
    movs r1, r2
    .global \greater
    .type \greater, %function
    .thumb_func
\greater:
    movs r2, r0
    orrs r2, r1
    bmi 5f
2:  cmp r0, r1
    \unless 9f
3:  lsls r0, #1                     @ the one further out
    lsrs r1, r0, #24
    cmp r1, #255
    beq 4f
8:  movs r0, #1
    bx lr
4:  lsls r0, #8
    beq 8b
9:  movs r0, #0
    bx lr
5:  movs r3, r0
    eors r3, r1
    bmi 6f
    movs r3, r0                     @ both negative
    movs r0, r1
    movs r1, r3
    b 2b
6:  lsls r2, #1
    beq \zeros
    cmp r0, #0
    bmi 9b
    lsls r1, #1
    lsrs r2, r1, #24
    cmp r2, #255
    bne 3b
    lsls r1, #8
    beq 3b
    b 9b
    .size \greater, . - \greater
    .size \less, \greater - \less
    .endm

    compare __aeabi_fcmplt, __aeabi_fcmpgt, ble, 9b
    compare __aeabi_fcmple, __aeabi_fcmpge, blt, 8b
