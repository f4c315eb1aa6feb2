/*
@HEADER@
 *
 * Use:
 *     PREFIX_state s;
 *     PREFIX_reset(&s, q, v, step);           start of a stretch; step [s] is the sampling interval
 *     PREFIX_effort(&s, q, v, a, tau);        once a sample: it moves the memory of dry friction on
 *
 * Rigid body: recursive Newton-Euler. Everything else: curves, straight between their knots.
 * C99, no heap. Compile with -lm.
 */
#include <math.h>
#include <string.h>

@DATA@

typedef struct {
    double turn[N_DRY + 1], before[N_DRY + 1];
    double bend[N_SLIP + 1][YIELDS], bristle[N_SLIP + 1], where[N_SLIP + 1];
} PREFIX_state;

const char *const *PREFIX_names(void) { return names; }
int PREFIX_size(void) { return NV; }
int PREFIX_state_size(void) { return (int)sizeof(PREFIX_state); }

static double clip(double x) { return x > 1.0 ? 1.0 : x < -1.0 ? -1.0 : x; }

static double sign(double x) { return (x > 0.0) - (x < 0.0); }

/* Value of curve c at x: straight between the knots, the end values beyond them. */
static double at(int c, double x) {
    int low = first[c], high = first[c + 1] - 1;
    if (x <= knot[low]) return value[low];
    if (x >= knot[high]) return value[high];
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (knot[middle] <= x) low = middle; else high = middle;
    }
    return value[low] + (x - knot[low]) / (knot[high] - knot[low]) * (value[high] - value[low]);
}

/* Direction without memory; slope 0 is the plain sign. */
static double direction(double speed, double rate) { return rate == 0.0 ? sign(speed) : clip(speed * rate); }

static void cross(const double a[3], const double b[3], double out[3]) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
}

/* out += s (a x b) */
static void add_cross(double s, const double a[3], const double b[3], double out[3]) {
    double c[3];
    cross(a, b, c);
    for (int k = 0; k < 3; k++) out[k] += s * c[k];
}

/* out = R x, or its transpose times x */
static void apply(const double R[9], const double x[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

static void back(const double R[9], const double x[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

/* R = A rotation(axis, angle) (Rodrigues) */
static void turned(const double A[9], const double u[3], double angle, double R[9]) {
    double s = sin(angle), c = 1.0 - cos(angle), T[9];
    double K[9] = {0.0, -u[2], u[1], u[2], 0.0, -u[0], -u[1], u[0], 0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double kk = 0.0;
            for (int m = 0; m < 3; m++) kk += K[3 * i + m] * K[3 * m + j];
            T[3 * i + j] = (i == j) + s * K[3 * i + j] + c * kk;
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            R[3 * i + j] = 0.0;
            for (int m = 0; m < 3; m++) R[3 * i + j] += A[3 * i + m] * T[3 * m + j];
        }
}

static void rigid_body(const double q[], const double v[], const double a[], double tau[]) {
    double R[BODIES][9], p[BODIES][3], w[BODIES][3], dw[BODIES][3], acc[BODIES][3];
    double force[BODIES][3], moment[BODIES][3];
    for (int i = 0; i < BODIES; i++) {
        const double *u = axis_[i], *c = centre_[i];
        double w0[3] = {0}, dw0[3] = {0}, a0[3] = {-gravity[0], -gravity[1], -gravity[2]}, spin[3], h[3];
        int k = column[i], up = parent[i];
        if (up >= 0) {
            memcpy(w0, w[up], sizeof w0);
            memcpy(dw0, dw[up], sizeof dw0);
            memcpy(a0, acc[up], sizeof a0);
        }
        memcpy(p[i], place_[i], sizeof p[i]);
        if (rotary[i]) {
            turned(rotation_[i], u, q[k], R[i]);
        } else {
            memcpy(R[i], rotation_[i], sizeof R[i]);
            apply(R[i], u, h);
            for (int m = 0; m < 3; m++) p[i][m] += h[m] * q[k];
        }
        add_cross(1.0, dw0, p[i], a0);
        cross(w0, p[i], h);
        add_cross(1.0, w0, h, a0);
        back(R[i], w0, w[i]);
        back(R[i], dw0, dw[i]);
        back(R[i], a0, acc[i]);
        for (int m = 0; m < 3; m++) spin[m] = u[m] * v[k];
        if (rotary[i]) {
            add_cross(1.0, w[i], spin, dw[i]);
            for (int m = 0; m < 3; m++) dw[i][m] += u[m] * a[k], w[i][m] += spin[m];
        } else {
            add_cross(2.0, w[i], spin, acc[i]);
            for (int m = 0; m < 3; m++) acc[i][m] += u[m] * a[k];
        }
        memcpy(force[i], acc[i], sizeof force[i]);
        add_cross(1.0, dw[i], c, force[i]);
        cross(w[i], c, h);
        add_cross(1.0, w[i], h, force[i]);
        for (int m = 0; m < 3; m++) force[i][m] *= mass[i];
        apply(inertia_[i], dw[i], moment[i]);
        apply(inertia_[i], w[i], h);
        add_cross(1.0, w[i], h, moment[i]);
        add_cross(1.0, c, force[i], moment[i]);
    }
    for (int j = 0; j < NV; j++) tau[j] = armature[j] * a[j];
    for (int i = BODIES - 1; i >= 0; i--) {
        const double *u = axis_[i], *load = rotary[i] ? moment[i] : force[i];
        tau[column[i]] += u[0] * load[0] + u[1] * load[1] + u[2] * load[2];
        if (parent[i] >= 0) {
            double f[3], n[3];
            apply(R[i], force[i], f);
            apply(R[i], moment[i], n);
            add_cross(1.0, p[i], f, n);
            for (int m = 0; m < 3; m++) force[parent[i]][m] += f[m], moment[parent[i]][m] += n[m];
        }
    }
}

/* What slides in dry contact k: one joint, or the sum of two that one motor turns. */
static double sliding(int k, const double x[]) {
    return x[dry_[k][0]] + (dry_[k][1] >= 0 ? x[dry_[k][1]] : 0.0);
}

/* Direction with memory, -1 to 1: it turns while the axis speeds up, else it holds. */
static void dry_friction(PREFIX_state *s, const double v[], const double a[], double tau[]) {
    for (int k = 0; k < N_DRY; k++) {
        double speed = sliding(k, v), rate = sliding(k, a), turn, effort;
        if (slope[k] == 0.0)
            s->turn[k] = sign(speed);
        else if (speed * rate > 0.0 || (rate == 0.0 && speed != 0.0))
            s->turn[k] = clip(s->turn[k] + (speed - s->before[k]) * slope[k]);
        s->before[k] = speed;
        turn = s->turn[k];
        effort = fabs(turn) * at(dry_[k][turn >= 0.0 ? 2 : 3], fabs(v[dry_[k][0]]));
        tau[dry_[k][0]] += effort;
        if (dry_[k][1] >= 0) tau[dry_[k][1]] += effort;
    }
}

/* Slip elements and a bristle, which bend before they slide. */
static void presliding(PREFIX_state *s, const double q[], const double v[], double tau[]) {
    for (int k = 0; k < N_SLIP; k++) {
        int j = slip_[k][0];
        double x_s = contact_[k][0], play = contact_[k][1], m = contact_[k][2], d = contact_[k][3];
        double move = q[j] - s->where[k], z = 0.0, rate = 0.0;
        move = move > play ? move - play : move < -play ? move + play : 0.0;
        s->where[k] += move;
        for (int i = 0; i < YIELDS; i++) {
            s->bend[k][i] = clip(s->bend[k][i] + move / yields_[k][i]);
            z += s->bend[k][i] / YIELDS;
        }
        if (move != 0.0) {
            s->bristle[k] = sign(move) + (s->bristle[k] - sign(move)) * exp(-fabs(move) / x_s);
            rate = (v[j] - fabs(v[j]) * s->bristle[k]) / x_s;
        }
        tau[j] += z * at(slip_[k][1], fabs(v[j])) + m * (s->bristle[k] - z) + d * rate;
    }
}

void PREFIX_reset(PREFIX_state *s, const double q[], const double v[], double step) {
    memset(s, 0, sizeof *s);
    for (int k = 0; k < N_DRY; k++) {
        s->before[k] = sliding(k, v);
        s->turn[k] = direction(s->before[k], slope[k]);
    }
    for (int k = 0; k < N_SLIP; k++) {
        double past = 20.0 * step * v[slip_[k][0]];
        for (int i = 0; i < YIELDS; i++) s->bend[k][i] = clip(past / yields_[k][i]);
        s->bristle[k] = sign(past) * (1.0 - exp(-fabs(past) / contact_[k][0]));
        s->where[k] = q[slip_[k][0]];
    }
}

void PREFIX_effort(PREFIX_state *s, const double q[], const double v[], const double a[], double tau[]) {
    rigid_body(q, v, a, tau);
    for (int j = 0; j < NV; j++) tau[j] += viscous[j] * v[j] + stiffness[j] * q[j];
    for (int k = 0; k < N_POSITION; k++) tau[position_[k][0]] += at(position_[k][1], q[position_[k][0]]);
    for (int k = 0; k < N_VELOCITY; k++) tau[velocity_[k][0]] += at(velocity_[k][1], v[velocity_[k][0]]);
    for (int k = 0; k < N_COUPLED; k++) {
        int i = coupled_[k][0], j = coupled_[k][1];
        tau[i] += tied_[k][0] * a[j] + tied_[k][1] * v[j];
        tau[j] += tied_[k][0] * a[i] + tied_[k][1] * v[i];
    }
    dry_friction(s, v, a, tau);
    presliding(s, q, v, tau);
}
