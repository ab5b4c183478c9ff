"""Every limit that a calibration's verdict rests on, in one place."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CameraLidarLimits", "CameraLimits", "CheckLimits", "LidarLimits"]


@dataclass(frozen=True, slots=True)
class LidarLimits:
    """Of LiDAR to LiDAR calibrations.

    Shares are of the structure (what stands out of the ground) that both sensors must have seen.

    Attributes:
        fewest_points: A cloud with fewer finite points in range is left out.
        fewest_seen: Fewer points of structure that both must have seen is no overlap.
        least_share: Least share within 0.1 m of the other's surface. Sparse scans of trees at a
            right pose reach 0.3; unrelated streets stay under 0.15.
        least_sharpness: Of what lies within 0.5 m, the share within 0.1 m. Chance gives 0.2.
        violation_doubtful: Share that the other sensor saw through, from which on a result is
            doubtful: moving objects and edges explain some hundredths.
        violation_bad: And from which on it is bad: unrelated scenes have 0.15 to 0.5.
        rival_score: Another pose that contradicts few rays (less than `violation_bad`) and has
            this much of the best one's score (share less violation) makes the answer ambiguous.
        same_rotation_deg: Poses within this and
        same_translation_m: this of each other are one answer.
        weak_doubtful: Information of the weakest direction over the strongest, below which the
            direction is called weak,
        weak_bad: and below which it is not determined at all.
        sd_translation_good_m: Largest standard deviation of a good result; 2 cm is what sensor
            noise and surfaces leave in real scenes.
        sd_rotation_good_deg: 0.1 deg is 9 cm at 50 m.
        sd_translation_doubtful_m: Beyond this a result is of no use.
        sd_rotation_doubtful_deg: Beyond this a result is of no use.
        offset_sd_m: Ranges of two sound sensors differ by about this much all over.
        offset_doubtful_m: An offset above this, and above `fault_sd` times its spread, is a fault
            of a sensor.
        tilt_doubtful_deg: Beams of the source that seem to point higher or lower than they are
            said to by more than this, and by `fault_sd` times its spread, are a wrong model.
        fault_sd: See `offset_doubtful_m`; wide, because surfaces are no perfect planes.
        moved_sd: Scenes that differ from the others by more than this many standard deviations
        moved_translation_m: and by more than this,
        moved_rotation_deg: or this, say that a sensor moved between them.
        loop_surprise: A round trip through registrations disagrees when it misses by more than
            this many standard deviations of its own; wide, because spreads that come from a few
            scenes have long tails.
        loop_floor_m: Misses below this and `loop_floor_deg` never count: range noise and the
            bias of a beam are of this size.
        loop_floor_deg: See `loop_floor_m`.
        loop_gross_m: A miss above this or `loop_gross_deg` counts whatever the spreads say, and
            makes the sensors on it bad: that much is seen in the merged cloud.
        loop_gross_deg: See `loop_gross_m`; at 10 m it moves a point by 9 cm.
        same_place_share: Two clouds of a sensor show one place when more than this share of the
            one (a point per half metre) lies within `same_place_m` of the other. A vehicle that
            stands still measures 0.7 to 0.9, one that went on by 2 m at most 0.5.
        same_place_m: See `same_place_share`.
        overlap_worth_a_loop: Two placed sensors are registered with each other too, as a check,
            when the one meets at least this share of the other's cells of half a metre.
        exchanged_off_m: A sensor found this far from its given place (metres, and a radian
            counted as one) may carry the name of another one,
        exchanged_share: namely when the other's given place is this many times nearer.
        worse_than_start: A result is worse than its start when every share of agreement is lower
            by this much; smaller differences are chance.
    """

    fewest_points: int = 500
    fewest_seen: int = 100
    least_share: float = 0.2
    least_sharpness: float = 0.3
    violation_doubtful: float = 0.06
    violation_bad: float = 0.12
    rival_score: float = 0.9
    same_rotation_deg: float = 2.0
    same_translation_m: float = 0.3
    weak_doubtful: float = 0.05
    weak_bad: float = 0.01
    sd_translation_good_m: float = 0.02
    sd_rotation_good_deg: float = 0.1
    sd_translation_doubtful_m: float = 0.1
    sd_rotation_doubtful_deg: float = 0.5
    offset_sd_m: float = 0.02
    offset_doubtful_m: float = 0.03
    tilt_doubtful_deg: float = 0.15
    fault_sd: float = 3.0
    moved_sd: float = 5.0
    moved_translation_m: float = 0.04
    moved_rotation_deg: float = 0.25
    loop_surprise: float = 3.0
    loop_floor_m: float = 0.01
    loop_floor_deg: float = 0.1
    loop_gross_m: float = 0.10
    loop_gross_deg: float = 0.5
    same_place_share: float = 0.6
    same_place_m: float = 0.1
    overlap_worth_a_loop: float = 0.1
    exchanged_off_m: float = 0.1
    exchanged_share: float = 0.3
    worse_than_start: float = 0.01


@dataclass(frozen=True, slots=True)
class CameraLimits:
    """Of camera intrinsics.

    Pixels are judged as a share of the image's width, so that the same lens is judged alike
    at any resolution: 0.001 is 1 px of 1000, about 5 cm at 50 m for a lens of 60 deg.

    Attributes:
        fewest_views: With fewer the camera is not determined, whatever the residuals.
        few_views: With fewer the tests on left-out views say little: at most doubtful.
        outliers_doubtful: Share of views with a board that do not fit the others; a few bad
            photographs are normal,
        outliers_bad: this many are two cameras, a moved zoom, or the wrong board.
        rms_doubtful_px: Corners are found to 0.1 to 0.3 px; more is blur or a board that is
            not flat,
        rms_bad_px: this much is no board of this kind at all.
        sd_good: Standard deviation of the projection over the image, median,
        sd_bad: and what makes a result useless in the middle of the image too.
        sd_edge_good: Its 95th percentile: the corners of the image.
        difference_good: Median projection difference between odd and even views; twice the
            standard deviation when all is well,
        difference_bad: and what no user wants to choose between.
        difference_edge_good: Its 95th percentile.
        surprise: Halves that differ by so many times what the noise explains show that the
            model of the lens, the board, or the views do not agree. Chance gives 2 at most.
        model_difference_good: Median difference in projection to another lens model that
            explains held-out views as well,
        model_difference_bad: and what makes the choice between them a guess.
        model_edge_good: Its 95th percentile.
        unseen_doubtful: Share of the image beyond the outermost corner on one side; there the
            lens is extrapolated,
        unseen_bad: so much of it leaves the principal point and the distortion to chance.
        coverage_good: Share of the image that some board covered.
        facing_doubtful_deg: Largest angle between two boards; boards that hardly turned leave
            focal length and distance to each other,
        facing_bad_deg: boards that all face one way do so entirely.
        tilted_deg: A board tilted by more than this against the line of sight counts as tilted.
        fewest_tilted: Fewer tilted views are doubtful.
        focal_good: Standard deviation over focal length; 0.002 is 2 % of a pixel in ten,
        focal_bad: and what makes it useless.
        bend_surprise: A bend of the board by more than so many standard deviations is believed.
        stretch_surprise: Columns that are longer than rows by more than so many standard deviations
            are believed, and so is a square board whose stretch is known so well.
        oblong_doubtful: Nearly all sensors have square pixels: a larger difference of fx and fy,
            unless the views show that the board is square, is the print's.
        fold_share: Share of the image's grid without a ray, from which on a distortion that
            folds back is a fault.
    """

    fewest_views: int = 3
    few_views: int = 8
    outliers_doubtful: float = 0.1
    outliers_bad: float = 0.3
    rms_doubtful_px: float = 0.5
    rms_bad_px: float = 2.0
    sd_good: float = 0.0005
    sd_bad: float = 0.005
    sd_edge_good: float = 0.0025
    difference_good: float = 0.001
    difference_bad: float = 0.01
    difference_edge_good: float = 0.005
    surprise: float = 3.0
    model_difference_good: float = 0.001
    model_difference_bad: float = 0.01
    model_edge_good: float = 0.005
    unseen_doubtful: float = 0.2
    unseen_bad: float = 0.33
    coverage_good: float = 0.6
    facing_doubtful_deg: float = 30.0
    facing_bad_deg: float = 15.0
    tilted_deg: float = 20.0
    fewest_tilted: int = 4
    focal_good: float = 0.002
    focal_bad: float = 0.02
    bend_surprise: float = 5.0
    stretch_surprise: float = 3.0
    oblong_doubtful: float = 0.003
    fold_share: float = 0.0


@dataclass(frozen=True, slots=True)
class CameraLidarLimits:
    """Of camera to LiDAR calibrations.

    Attributes:
        fewest_pairs_good: Halves of fewer pairs could not be solved for themselves, and nothing
            would test the result.
        fewest_pairs_doubtful: Two pairs fix a transform that nothing contradicts.
        share_good: Of the pairs in which both found the board, so many must agree; wrong files
            and boards that moved are rare in a sound capture.
        share_doubtful: Below this most pairs contradict the result.
        rival_share: Another transform that brings so many as many pairs together makes the
            result ambiguous.
        sd_rotation_good_deg: 0.2 deg are 17 cm at 50 m.
        sd_rotation_doubtful_deg: 1 deg is 87 cm at 50 m, of no use to any fusion.
        sd_translation_good_m: What a sparse LiDAR's edges and range noise allow from ten poses.
        sd_translation_doubtful_m: A ruler does better.
        halves_z: Halves may differ by so many standard deviations of their difference; twelve
            differences are looked at, and 3.5 leaves one false alarm in 180 runs.
        halves_floor_deg: Smaller differences of halves are never held against a result,
        halves_floor_m: nor are these.
        halves_good_deg: Larger differences always are,
        halves_good_m: and these too.
        smallest_tilt_deg: Root mean square turn of the boards about either axis; below it a shift
            along the boards rests on their outlines alone.
        largest_condition: Of the stacked normals; the coach of Tsai et al. 2021 wants less.
        smallest_distance_ratio: Farthest over nearest board; below it a range error looks like
            a shift.
        smallest_width_deg: Boards within this angle cannot tell a turn from a shift.
        scale_z: A board size or focal length is off when the data say so by so many standard
            deviations,
        scale_good: and by more than this share,
        scale_bad: and beyond this share the result is wrong by about as much of the distance.
        range_systematic_m: LiDARs measure near and far boards differently by so much (data sheets
            say up to 3 cm); over the spread of distances it looks like a scale.
        centre_good_deg: A principal point that is off looks like a turn by as much,
        centre_bad_deg: and beyond this it is wrong by what is of no use to any fusion.
        pattern_good_m: A pattern that lies farther off the plate's middle shifts the result by
            about as much,
        pattern_sd_m: and where that is not known to this, it cannot be told from a shift.
        corner_good_px: Root mean square of corners about the joint solution; corners are found
            to 0.1 to 0.3 px, so more is a wrong lens model.
        corner_doubtful_px: More is another camera.
        point_good_m: Root mean square of points about the boards; spinning LiDARs have 2 to 3 cm.
        point_doubtful_m: More is no plane.
        plate_good: The plate's sides as the LiDAR sees them may differ by this share.
    """

    fewest_pairs_good: int = 6
    fewest_pairs_doubtful: int = 3
    share_good: float = 0.8
    share_doubtful: float = 0.6
    rival_share: float = 0.8
    sd_rotation_good_deg: float = 0.2
    sd_rotation_doubtful_deg: float = 1.0
    sd_translation_good_m: float = 0.015
    sd_translation_doubtful_m: float = 0.05
    halves_z: float = 3.5
    halves_floor_deg: float = 0.05
    halves_floor_m: float = 0.003
    halves_good_deg: float = 0.5
    halves_good_m: float = 0.03
    smallest_tilt_deg: float = 5.0
    largest_condition: float = 25.0
    smallest_distance_ratio: float = 1.2
    smallest_width_deg: float = 8.0
    scale_z: float = 3.0
    scale_good: float = 0.005
    scale_bad: float = 0.03
    range_systematic_m: float = 0.01
    centre_good_deg: float = 0.3
    centre_bad_deg: float = 1.0
    pattern_good_m: float = 0.005
    pattern_sd_m: float = 0.01
    corner_good_px: float = 1.0
    corner_doubtful_px: float = 3.0
    point_good_m: float = 0.04
    point_doubtful_m: float = 0.08
    plate_good: float = 0.06


@dataclass(frozen=True, slots=True)
class CheckLimits:
    """Of the comparison of a calibration with a new log.

    A rig file does not say how well it was measured. It is taken to be as good as the new
    measurement, so that the standard deviation of a difference is the root of 2 of the new one.

    Attributes:
        tolerance_sd: An axis holds when it is off by no more than so many standard deviations of
            the difference,
        lidar_floor_m: or than this: LiDARs differ by 1 to 3 cm in range, with surface and warmth,
            and a calibration that counts as good has a standard deviation of this,
        lidar_floor_deg: and of this.
        camera_floor_m: The same between a camera and a LiDAR: boards average many points, and
        camera_floor_deg: these are twice what halves of a good capture differ by.
        moved_sd: A sensor moved when an axis is off by more than so many standard deviations of
            the difference (with some twenty axes looked at, 3 would be a false alarm in 20 logs),
        moved_m: and by more than this: what LiDARs differ by in range never counts as a move,
        moved_deg: nor what that does to a turn, 3 cm at 10 m and 5 cm at 10 m.
        one_scene_m: From one scene, which nothing confirms, it takes this,
        one_scene_deg: or this.
        between_scenes_sd: Scenes of one log contradict each other in an axis beyond so many
            standard deviations of their difference, and beyond `between_scenes_m` or `_deg`.
        between_scenes_m: See `between_scenes_sd`.
        between_scenes_deg: See `between_scenes_sd`.
        control_m: The known-bad control: a shift of this much along an axis, planted into data
            that the estimate was not made from, has to be found, or the axis is not judged.
        control_deg: The same about an axis.
        reprojection_px: Corners that fit their board no better than this say that the intrinsics
            are not this camera's.
        focal_share: A focal length that is off by more than this share, and
        focal_sd: by so many standard deviations, likewise.
    """

    tolerance_sd: float = 3.0
    lidar_floor_m: float = 0.02
    lidar_floor_deg: float = 0.1
    camera_floor_m: float = 0.01
    camera_floor_deg: float = 0.1
    moved_sd: float = 4.0
    moved_m: float = 0.03
    moved_deg: float = 0.3
    one_scene_m: float = 0.05
    one_scene_deg: float = 0.5
    between_scenes_sd: float = 5.0
    between_scenes_m: float = 0.05
    between_scenes_deg: float = 0.3
    control_m: float = 0.05
    control_deg: float = 1.0
    reprojection_px: float = 1.0
    focal_share: float = 0.01
    focal_sd: float = 4.0
