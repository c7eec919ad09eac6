"""All experiments: the papers' figures and tables, and studies of our own beyond them.

Names are strings until an experiment runs, so that listing them imports neither Drake nor
Matplotlib. A name without a module is one of the entry's own ``module``.
"""

from functools import partial
from typing import Final

from chamfer.analysis.scenario.experiment import Catalogue, Entry

SERVOING: Final = "fsm-visual-servoing"
HYBRID: Final = "hybrid-force-position"
PRIMITIVES: Final = "sensorimotor-primitives"

# path=value: the smallest runs of scenarios of the hybrid loop.
_SHORT: Final = ("trials=1", "duration=3", "measure_after=2")
_PLANAR: Final = ("task.speed=1", "duration=2.5", "measure_after=2")

# The same of insertions by sight.
_INSERTED: Final = (
    "begin=0.2",
    "gap=0.01",
    "initial_error=[0, 0.001, -0.001, 0, 0.01, -0.01]",
    "insert.depth=0.015",
    "insert.speed=0.06",
    "insert.rest=0.05",
    "duration=2",
)

# Experiments that share most of what they are.
_servoing = partial(Entry, paper=SERVOING)
_hybrid = partial(Entry, paper=HYBRID)
_primitives = partial(Entry, paper=PRIMITIVES)
_servoing_study = partial(_servoing, study=True, seconds=300)
_hybrid_study = partial(_hybrid, study=True, seconds=300)
_primitives_study = partial(_primitives, study=True, seconds=300)
_servo = partial(
    _servoing,
    seconds=2,
    module="chamfer.analysis.servo.servo_response",
    resolve="chamfer.diagrams.servo.servo_scenario:resolve",
    diagram="make_diagram",
    charts="make_charts",
)
_connector = partial(
    _primitives,
    module="chamfer.analysis.skills.connector_insertion",
    resolve="chamfer.diagrams.skills.connector_scenario:resolve",
    diagram="chamfer.diagrams.skills.connector_loop:make_connector_diagram",
    charts="skill_charts",
    replay="replay_insertion",
    reduced=("step=0.002",),
)
_success = partial(
    _primitives_study,
    figure="section 4",
    module="chamfer.analysis.skills.connector_campaign",
    resolve="resolve_campaign",
    run="run_success",
    plot="success_figures",
    reduced=("trials=1", "duration=3.0"),
)
_ablation = partial(
    _primitives_study,
    module="chamfer.analysis.skills.connector_campaign",
    resolve="resolve_campaign",
    run="run_ablation",
    plot="ablation_figures",
    reduced=("trials=1", "duration=0.1"),
)
_wall = partial(
    _hybrid,
    figure="section 6.3",
    module="chamfer.analysis.surface.unknown_wall",
    resolve="chamfer.diagrams.surface.unknown_wall_loop:resolve_wall",
    run="run_wall_trials",
    diagram="chamfer.diagrams.surface.unknown_wall_loop:make_unknown_wall_diagram",
    charts="make_charts",
    reduced=("trials=1", "duration=2.5", "measure_after=2", "task.kick_time=1.8"),
)
_estimation = partial(
    _hybrid,
    module="chamfer.analysis.surface.unknown_surface",
    resolve="chamfer.diagrams.surface.surface_estimation:resolve_estimation",
    run="run_trials",
    diagram="chamfer.diagrams.surface.surface_estimation:make_estimation_diagram",
    reduced=("trials=2", "lead.halt=1.5", "duration=2"),
)
_tracking = partial(
    _hybrid,
    module="chamfer.analysis.surface.unknown_surface",
    resolve="chamfer.diagrams.surface.surface_tracking:resolve_tracking",
    run="run_trials",
    diagram="chamfer.diagrams.surface.surface_tracking:make_tracking_diagram",
)


def _contact(
    name: str, figure: str, summary: str, *reduced: str, run: str = "run_trials", module: str = ""
) -> Entry:
    """Return a scenario of the hybrid loop that runs, is drawn and is resolved as all of them."""
    constant = name.replace("-", "_")
    return _hybrid(
        name=name,
        figure=figure,
        summary=summary,
        module=module or "chamfer.analysis.contact.contact_runs",
        scenario=f"chamfer.diagrams.contact.contact_scenarios:{constant.upper()}",
        resolve="chamfer.diagrams.contact.hybrid_loop_stability:resolve",
        run=run,
        plot="figures" if module else f"chamfer.analysis.contact.contact_figures:{constant}",
        diagram="chamfer.diagrams.contact.hybrid_loop:make_hybrid_diagram",
        charts="chamfer.analysis.contact.contact_runs:contact_charts",
        reduced=reduced,
    )


CATALOGUE: Final = Catalogue(
    published="chamfer.analysis.published",
    entries=(
        _servoing_study(
            name="jamming-diagram",
            figure="Fig. 1",
            summary="which loads slide the peg over its depth, with those of simulated insertions",
            module="chamfer.analysis.insertion.jamming_diagram",
            scenario="JAMMING",
            resolve="resolve",
            reduced=(
                "insertion.depth=0.015",
                "insertion.speed=0.1",
                "insertion.step=0.002",
                "insertion.force_cap=20",
                "tilts=[0.06]",
                "laterals=[0.0]",
            ),
        ),
        _servoing(
            name="peg-insertion",
            figure="Fig. 1",
            summary="a peg on a spring support is fed into its hole: forces, "
            "contact states, wedging",
            seconds=3,
            module="chamfer.analysis.insertion.peg_insertion",
            scenario="chamfer.diagrams.insertion.peg_insertion:PEG_INSERTION",
            resolve="chamfer.diagrams.insertion.peg_insertion:resolve_peg_insertion",
            diagram="chamfer.diagrams.insertion.peg_insertion:make_peg_insertion_diagram",
            replay="chamfer.analysis.insertion.peg_insertion:replay_peg_insertion",
            reduced=("depth=0.008", "gap=0.001", "step=0.002", "speed=0.05"),
        ),
        _servoing(
            name="wedging-diagram",
            figure="Fig. 2",
            summary="from which initial errors the peg goes in without wedging, "
            "and with what force",
            seconds=22,
            module="chamfer.analysis.cell.wedging_diagram",
            scenario="WEDGING",
            resolve="resolve",
            reduced=(
                "alignment.trials=2",
                "alignment.begin=0.2",
                "alignment.compensation_time=0.6",
                "points=41",
            ),
        ),
        _servoing_study(
            name="insertion-map",
            figure="Fig. 2",
            summary="which errors go in, wedge, jam or miss in the cell, beside "
            "what theory says of them",
            module="chamfer.analysis.insertion.insertion_map",
            scenario="INSERTION_MAP",
            resolve="resolve",
            reduced=(
                "points=1",
                "planes=[xy]",
                "drawn=null",
                "cell.depth=0.01",
                "cell.feed=0.03",
                "cell.gap=0.002",
                "cell.speed=0.1",
                "cell.step=0.002",
                "cell.contact.facets=32",
            ),
        ),
        _servoing(
            name="plant-identification",
            figure="Fig. 8",
            summary="the plants whose PID loop has the published rise time and overshoot",
            seconds=3,
            module="chamfer.analysis.servo.plant_identification",
            scenario="IDENTIFICATION",
            reduced=("plant.stiffness=[700]",),
        ),
        _servo(
            name="step-response",
            figure="Fig. 8",
            summary="PID and FSM loop answer a step of 1 m",
            scenario="chamfer.diagrams.servo.servo_scenario:STEP",
            run="run_step",
            run_swept="run_step_compiled",
            plot="step_figures",
        ),
        _servo(
            name="sinusoid-response",
            figure="Fig. 9",
            summary="PID and FSM loop follow a sinusoid between -1 and 1 m",
            scenario="chamfer.diagrams.servo.servo_scenario:SINUSOID",
            run="run_sinusoid",
            run_swept="run_sinusoid_compiled",
            plot="sinusoid_figures",
        ),
        _servoing(
            name="vertical-tracking",
            figure="Fig. 11",
            summary="the peg goes up to the hole's height, with and without compensation by sight",
            seconds=12,
            module="chamfer.analysis.cell.alignment",
            scenario="chamfer.diagrams.cell.alignment_scenario:VERTICAL_TRACKING",
            run="run_tracking",
            plot="tracking_figures",
            resolve="resolve_tracking",
            diagram="chamfer.diagrams.cell.alignment:make_alignment_diagram",
            charts="chamfer.analysis.cell.alignment_runs:alignment_charts",
            reduced=("motion_time=0.5", "begin=0.3", "compensation_time=0.3"),
        ),
        _servoing(
            name="alignment",
            figure="Figs. 12-14",
            summary="cameras and compensator align peg and hole from pixels to torques",
            module="chamfer.analysis.cell.alignment",
            scenario="chamfer.diagrams.cell.alignment_scenario:BY_SIGHT",
            resolve="resolve_alignment",
            diagram="chamfer.diagrams.cell.alignment:make_alignment_diagram",
            charts="chamfer.analysis.cell.alignment_runs:alignment_charts",
            replay="chamfer.analysis.cell.alignment:replay_alignment",
            reduced=("begin=0.2", "compensation_time=0.6"),
        ),
        _servoing_study(
            name="fsm-stability",
            figure="section 3",
            summary="where the FSM settles, reverses and cycles, against the settling theorem",
            module="chamfer.analysis.servo.fsm_stability",
            scenario="STABILITY",
            diagram="make_diagram",
            reduced=("map.points=7", "map.trials=1", "map.settings=20"),
        ),
        _servoing_study(
            name="camera-accuracy",
            figure="section 4",
            summary="how exactly both cameras see the parts: tips, axes, error "
            "signal, and in space",
            module="chamfer.analysis.sight.camera_accuracy",
            scenario="ACCURACY",
            resolve="resolve_camera_accuracy",
            reduced=("poses=3",),
        ),
        _servoing_study(
            name="detection-conditions",
            figure="section 4",
            summary="in which light and with what beside them the parts are "
            "found, refused, or mistaken",
            module="chamfer.analysis.sight.detection_conditions",
            scenario="STUDY",
            resolve="resolve_detection_conditions",
            reduced=("pictures=1",),
        ),
        _servoing(
            name="repeatability",
            figure="section 5",
            summary="many alignments with random starts and model errors, and "
            "the margins they leave",
            seconds=42,
            module="chamfer.analysis.cell.alignment",
            scenario="chamfer.analysis.cell.alignment_runs:REPEATABILITY",
            resolve="chamfer.analysis.cell.alignment_runs:resolve_repeatability",
            run="run_repeatability",
            plot="repeatability_figures",
            reduced=("trials=2", "begin=0.2", "compensation_time=0.6"),
        ),
        _servoing_study(
            name="camera-errors",
            figure="section 5",
            summary="what errors of the cameras leave of the alignment, each "
            "alone and all at once",
            module="chamfer.analysis.cell.camera_errors",
            scenario="CAMERA_ERRORS",
            resolve="resolve",
            diagram="chamfer.diagrams.cell.alignment:make_alignment_diagram",
            reduced=(
                "trials=1",
                "points=1",
                "errors=[distortion_off_axis]",
                "begin=0.2",
                "soon=0.1",
                "compensation_time=0.1",
            ),
        ),
        _servoing_study(
            name="design-accuracy",
            figure="section 5",
            summary="whether designs are what they are called: randomised cells, each "
            "assessed and simulated",
            module="chamfer.analysis.design.design_accuracy",
            scenario="DRAWN_DESIGNS",
            reduced=("designs=2", "trials=1", "draws=72", "duration=0.4"),
        ),
        _servoing(
            name="insertion",
            figure="section 5",
            summary="cameras align peg and hole, a chart decides and inserts: "
            "from pixels to a seated peg",
            seconds=12,
            module="chamfer.analysis.insertion.insertion",
            scenario="chamfer.diagrams.insertion.insertion:INSERTION_BY_SIGHT",
            resolve="resolve_insertion",
            diagram="chamfer.diagrams.insertion.insertion:make_insertion_diagram",
            charts="chamfer.analysis.insertion.cell_runs:insertion_charts",
            replay="chamfer.analysis.cell.alignment:replay_alignment",
            reduced=_INSERTED,
        ),
        _servoing_study(
            name="insertion-repeatability",
            figure="section 5",
            summary="many insertions by sight from random starts: success, "
            "force, time, and other ways",
            module="chamfer.analysis.insertion.insertion_repeatability",
            scenario="chamfer.analysis.insertion.insertion_repeatability:INSERTION_REPEATABILITY",
            resolve="chamfer.analysis.insertion.insertion_repeatability:resolve_insertion_trials",
            reduced=(
                *_INSERTED,
                "trials=1",
                "beside=[frozen]",
                "spread.lateral=0.001",
                "spread.rotational=0.01",
            ),
        ),
        _servoing_study(
            name="calibration-accuracy",
            summary="how exactly cameras are calibrated from rendered boards, and if it says so",
            module="chamfer.analysis.calibration.calibration_accuracy",
            scenario="CALIBRATION",
            reduced=("sets=2", "pictures=5"),
        ),
        _servoing_study(
            name="alignment-fsm-vs-pid",
            summary="the state machine against a PID law in the work cell, from the same starts",
            module="chamfer.analysis.cell.alignment_comparison",
            scenario="COMPARISON",
            resolve="resolve",
            diagram="chamfer.diagrams.cell.alignment:make_alignment_diagram",
            reduced=("trials=2", "begin=0.2", "compensation_time=0.6"),
        ),
        _servoing_study(
            name="contact-convergence",
            summary="depth and forces of an insertion over steps, stiffness, "
            "facets and approximations",
            module="chamfer.analysis.insertion.contact_convergence",
            scenario="CONVERGENCE",
            resolve="resolve",
            reduced=(
                "insertion.depth=0.014",
                "insertion.tilt=0.06",
                "insertion.speed=0.1",
                "insertion.step=0.002",
                "steps=[0.002]",
                "stiffnesses=[1e6]",
                "facets=[64]",
                "stictions=[1e-4]",
                "approximations=[lagged]",
                "accuracies=[1e-2]",
            ),
        ),
        _servoing_study(
            name="servo-comparison",
            summary="FSM or PID for a plant and a camera of one's own, both "
            "designed from one number",
            module="chamfer.analysis.servo.servo_comparison",
            scenario="COMPARISON",
            resolve="resolve_comparison",
            diagram="make_diagram",
            reduced=("trials=1", "duration=1.6"),
        ),
        _contact(
            "planar-hold",
            "Fig. 2-5",
            "a two-link arm touches the crucible and pushes with 15 N",
            *_PLANAR,
        ),
        _contact(
            "planar-slide",
            "Fig. 2-6",
            "it slides along the crucible and keeps the force",
            *_PLANAR,
        ),
        _contact(
            "planar-slide-late",
            "Fig. 2-6",
            "the same with a torque one sample late, which the thesis' gains would not bear",
            *_PLANAR,
        ),
        _contact(
            "puma-roller-hold", "Fig. 3-5", "the Puma 250 presses a roller on a table", *_SHORT
        ),
        _contact("puma-roller-motion", "Fig. 3-6", "the Puma 250 rolls along a table", *_SHORT),
        _contact(
            "puma-roller-motion-soft",
            "section 3.1.4",
            "the same on a table that is more compliant and damped",
            *_SHORT,
        ),
        _contact(
            "puma-nugget-hold",
            "Fig. 3-7",
            "the Puma 250 presses a nugget on a glass wall",
            *_SHORT,
        ),
        _contact(
            "puma-nugget-motion",
            "Fig. 3-8",
            "the Puma 250 slides a nugget along a glass wall",
            *_SHORT,
        ),
        _contact(
            "adept-roller-hold",
            "Fig. 3-11",
            "the Adept One presses a roller on a plate",
            "task.speed=0.05",
            *_SHORT,
        ),
        _contact(
            "adept-roller-motion",
            "Fig. 3-12",
            "the Adept One rolls along a plate",
            "task.speed=0.05",
            *_SHORT,
        ),
        _contact(
            "adept-nugget-hold",
            "Fig. 3-13",
            "the Adept One presses a nugget on a metal wall",
            *_SHORT,
        ),
        _contact(
            "adept-nugget-motion",
            "Fig. 3-14",
            "the Adept One slides a nugget along a metal wall",
            *_SHORT,
        ),
        _contact(
            "wrist-contention",
            "Fig. 3-15",
            "the wrist's angular integrator disturbs the force, switched off it does not",
            "task.speed=0.05",
            *_SHORT,
            run="run_contention",
            module="chamfer.analysis.contact.wrist_contention",
        ),
        _estimation(
            name="surface-estimation",
            figure="Fig. 5-3",
            summary="a gripper slides along an unknown surface, and an observer "
            "estimates the normal",
            seconds=10,
            scenario="chamfer.diagrams.surface.surface_estimation:SURFACE_ESTIMATION",
            plot="estimation_figures",
        ),
        _estimation(
            name="surface-estimation-smooth",
            figure="Fig. 5-4",
            summary="the same with a surface that is known to be smooth",
            seconds=9,
            scenario="chamfer.diagrams.surface.surface_estimation:SMOOTH",
            plot="smooth_figures",
        ),
        _estimation(
            name="surface-estimation-noise-free",
            figure="Fig. 5-5",
            summary="the same without noise: the normal is found exactly",
            seconds=3,
            scenario="chamfer.diagrams.surface.surface_estimation:NOISE_FREE",
            plot="noise_free_figures",
            reduced=("lead.halt=1.5", "duration=2"),
        ),
        _estimation(
            name="surface-estimation-large-noise",
            figure="Fig. 5-6",
            summary="the same with a sensor that is taken to be useless: the first estimate stays",
            scenario="chamfer.diagrams.surface.surface_estimation:LARGE_NOISE",
            plot="large_noise_figures",
        ),
        _tracking(
            name="unknown-surface-control",
            figure="Fig. 5-8",
            summary="force and motion are controlled along an estimated surface",
            seconds=24,
            scenario="chamfer.diagrams.surface.surface_tracking:SURFACE_CONTROL",
            plot="control_figures",
            reduced=("trials=2", "duration=2"),
        ),
        _tracking(
            name="unknown-surface-control-noise-free",
            figure="Fig. 5-9",
            summary="the same without noise: the force settles at the desired one",
            seconds=3,
            scenario="chamfer.diagrams.surface.surface_tracking:SURFACE_CONTROL_NOISE_FREE",
            plot="control_noise_free_figures",
            reduced=("duration=2",),
        ),
        _hybrid(
            name="crucible-charging",
            figure="section 1.1.2",
            summary="the Adept One with its wrist charges a crucible, nugget by nugget",
            seconds=35,
            module="chamfer.analysis.charging.crucible_charging",
            scenario="chamfer.diagrams.charging.charging_scenario:CRUCIBLE_CHARGING",
            resolve="chamfer.diagrams.charging.charging_scenario:resolve_charging",
            run="run_crucible_charging",
            diagram="chamfer.diagrams.charging.charging_loop:make_charging_diagram",
            charts="make_charts",
            replay="chamfer.analysis.charging.charging_replay:replay_charging",
            reduced=("plan=[{kind: wall}]", "duration=2.5"),
        ),
        _hybrid_study(
            name="hybrid-stability",
            figure="section 2.1.3",
            summary="where the Jacobian-inverse law is unstable out of contact, "
            "and what the loop bears",
            module="chamfer.analysis.contact.hybrid_stability",
            scenario="HYBRID_STABILITY",
            resolve="resolve_hybrid_stability",
            run="run_stability",
            reduced=("points=5", "start=[1.0, -1.4]"),
        ),
        _hybrid_study(
            name="contact-recovery",
            figure="section 2.1.4",
            summary="a blow breaks the contact: bounces that grow, and a mode that ends them",
            module="chamfer.analysis.contact.contact_recovery",
            scenario="chamfer.diagrams.contact.contact_scenarios:CONTACT_RECOVERY",
            resolve="chamfer.diagrams.contact.hybrid_loop_stability:resolve",
            run="run_recovery",
            diagram="chamfer.diagrams.contact.hybrid_loop:make_hybrid_diagram",
            charts="chamfer.analysis.contact.contact_runs:contact_charts",
            reduced=("task.speed=1", "task.kick_time=2.2", "measure_after=2", "duration=3"),
        ),
        _hybrid_study(
            name="friction-remedies",
            figure="section 3.3",
            summary="what friction compensation, decoupling and full-dynamics control buy",
            module="chamfer.analysis.contact.friction_remedies",
            scenario="FRICTION_REMEDIES",
            resolve="resolve_friction_remedies",
            run="run_remedies",
            reduced=(
                "trials=1",
                "roller.task.speed=0.05",
                "roller.duration=1",
                "roller.measure_after=0.5",
                "nugget.task.speed=0.05",
                "nugget.duration=1",
                "nugget.measure_after=0.5",
            ),
        ),
        _hybrid_study(
            name="observer-model-error",
            figure="section 4.2",
            summary="observers that are told a wrong stiffness, with a bias, a "
            "delay, a differenced rate",
            module="chamfer.analysis.surface.observer_model_error",
            scenario="MODEL_ERROR",
            resolve="resolve_model_error",
            run="run_model_error",
            reduced=("surfaces=[constant, space_ball]", "trials=1", "latest=1"),
        ),
        _hybrid_study(
            name="observer-comparison",
            figure="section 4.5",
            summary="eight observers of the normal on the same slides: error, "
            "honesty of the band, cost",
            seconds=600,
            module="chamfer.analysis.surface.observer_comparison",
            scenario="OBSERVER_COMPARISON",
            resolve="resolve_comparison",
            run="run_comparison",
            reduced=("trials=1", "suite.trials=1", "suite.surfaces=[bend_5, constant]"),
        ),
        _tracking(
            name="unknown-surface-control-adaptive",
            figure="section 5.3.4",
            summary="the same by the adaptive observer, which is given means of the force",
            seconds=20,
            scenario="chamfer.diagrams.surface.surface_tracking:SURFACE_CONTROL_ADAPTIVE",
            plot="control_adaptive_figures",
            reduced=("trials=2", "duration=2"),
        ),
        _hybrid_study(
            name="sensing-sensitivity",
            figure="section 6.2",
            summary="what each imperfection of sensors and computer costs the hybrid loops",
            module="chamfer.analysis.contact.sensing_sensitivity",
            scenario="SENSING_SENSITIVITY",
            resolve="resolve_sensing_sensitivity",
            run="run_sensitivity",
            reduced=(
                "approaches=1",
                "approach.task.speed=1",
                "approach.duration=0.3",
                "planar.duration=0.2",
                "planar.measure_after=0.1",
                "puma.duration=0.1",
                "puma.measure_after=0.05",
                "adept.duration=0.2",
                "adept.measure_after=0.1",
            ),
        ),
        _hybrid_study(
            name="charging-campaign",
            figure="section 6.3",
            summary="how many drawn charging cycles keep each limit, as they are "
            "and with remedies",
            module="chamfer.analysis.charging.charging_campaign",
            scenario="CHARGING_CAMPAIGN",
            resolve="resolve_campaign",
            run="run_campaign",
            reduced=("remedies=[none]", "cycle.plan=[{kind: wall}]", "cycle.duration=1"),
        ),
        _wall(
            name="adept-unknown-wall",
            summary="the Adept One finds an unknown wall and slides along it",
            seconds=22,
            scenario="chamfer.diagrams.surface.unknown_wall_loop:ADEPT_WALL",
            plot="adept_figures",
        ),
        _wall(
            name="puma-unknown-wall",
            summary="the Puma 250 finds an unknown wall and slides along it",
            seconds=17,
            scenario="chamfer.diagrams.surface.unknown_wall_loop:PUMA_WALL",
            plot="puma_figures",
        ),
        _wall(
            name="planar-unknown-wall",
            summary="the two-link arm finds an unknown wall and slides along it",
            seconds=22,
            scenario="chamfer.diagrams.surface.unknown_wall_loop:PLANAR_WALL",
            plot="planar_figures",
            reduced=("trials=1", "duration=3.5", "measure_after=3", "task.kick_time=2.8"),
        ),
        _primitives(
            name="lissajous",
            figure="Fig. 2",
            summary="what two dithers with the frequency ratio (N + 1) / N cover",
            module="chamfer.analysis.skills.lissajous",
            scenario="LISSAJOUS",
            reduced=("repeats=[2, 4]",),
        ),
        _primitives(
            name="skill",
            figure="Fig. 4",
            summary="a skill of one's own, from a YAML file, runs with a "
            "connector or a part of one's own",
            module="chamfer.analysis.skills.own_skill",
            scenario="OWN_SKILL",
            resolve="resolve_own_skill",
            diagram="make_diagram",
            charts="chamfer.analysis.skills.connector_insertion:skill_charts",
            replay="show_replay",
            reduced=("step=0.002", "duration=3.0"),
        ),
        _connector(
            name="d-connector",
            figure="Fig. 5",
            summary="a skill grasps a 25-pin D connector by sight and inserts it by force",
            seconds=9,
            scenario="chamfer.diagrams.skills.connector_scenario:D_CONNECTOR",
        ),
        _connector(
            name="bnc-connector",
            figure="Fig. 6",
            summary="a skill grasps a BNC connector by sight, finds its slots by "
            "force and locks it",
            seconds=9,
            scenario="chamfer.diagrams.skills.connector_scenario:BNC_CONNECTOR",
        ),
        _primitives(
            name="correlation",
            figure="eq. (1)",
            summary="what the correlation of command and motion shows, and what it cannot",
            module="chamfer.analysis.skills.correlation_cases",
            scenario="CASES_SCENARIO",
            resolve="resolve_cases",
            diagram="chamfer.diagrams.skills.dither_loops:make_correlation_diagram",
            reduced=("dither.cycles=5",),
        ),
        _connector(
            name="peg-skill",
            figure="section 2",
            summary="a skill grasps a round peg by sight, aligns it by touch and "
            "searches its hole",
            scenario="chamfer.diagrams.skills.connector_scenario:ROUND_PEG",
        ),
        _success(
            name="peg-skill-success",
            figure="section 2",
            summary="a round peg is inserted in many randomised scenarios, by dithers, along a "
            "spiral and leaning",
            scenario="ROUND_PEG",
            resolve="resolve_peg_campaign",
            run="run_searches",
            plot="search_figures",
            reduced=("trials=1", "compared=[]", "step=0.002"),
        ),
        _primitives(
            name="vision-primitives",
            figure="section 3.1",
            summary="vision primitives settle with wrongly calibrated cameras, "
            "and how wrong they may be",
            seconds=23,
            module="chamfer.analysis.skills.vision_trials",
            scenario="VISION_PRIMITIVES",
            diagram="make_diagram",
            reduced=("trials=1", "map_focal=[1.0]", "map_angle=[0.0]"),
        ),
        _connector(
            name="rj45-connector",
            figure="section 4",
            summary="a skill grasps an RJ45 plug by sight, aligns it by touch and latches it",
            seconds=8,
            scenario="chamfer.diagrams.skills.connector_scenario:RJ45_CONNECTOR",
        ),
        _success(
            name="d-connector-success",
            summary="a 25-pin D connector is grasped and inserted in many randomised scenarios",
            scenario="D_CONNECTOR",
        ),
        _success(
            name="bnc-connector-success",
            summary="a BNC connector is grasped and inserted in many randomised scenarios",
            scenario="BNC_CONNECTOR",
        ),
        _success(
            name="rj45-connector-success",
            summary="an RJ45 plug is grasped and inserted in many randomised scenarios",
            scenario="RJ45_CONNECTOR",
            reduced=("trials=1", "step=0.002"),
        ),
        _ablation(
            name="d-connector-ablation",
            summary="a 25-pin D connector is inserted by skills that lack one of their primitives",
            scenario="D_ABLATION",
        ),
        _ablation(
            name="bnc-connector-ablation",
            summary="a BNC connector is inserted by skills that lack one of their primitives",
            scenario="BNC_ABLATION",
        ),
    ),
)
